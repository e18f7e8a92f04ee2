"""The package's front door: its names exist, nothing heavy loads before it is used, and the README tells no more."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import kumitate as km
from kumitate.tasks import cli
from kumitate.tasks.verify_faults import FAULTS


def test_every_public_name_exists():
    assert km.__all__
    for name in km.__all__:
        assert getattr(getattr(km, name), "__name__", name) == name


def test_unknown_names_are_attribute_errors():
    assert not hasattr(km, "no_such_name")


def test_importing_the_package_loads_no_heavy_library():
    heavy = ["pinocchio", "coal", "ompl", "fcl", "trimesh", "scipy", "toppra", "networkx", "meshcat", "numpy"]
    code = f"import sys, kumitate; print([name for name in {heavy} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_the_readme_speaks_of_what_is_there():
    readme = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| `([a-z-]+)` \| (.+) \|$", readme.partition("| fault | |")[2], re.MULTILINE))
    assert told == FAULTS
    parser = cli._parser()
    for command in re.findall(r"^kumitate (\w+)", readme, re.MULTILINE):
        with pytest.raises(SystemExit) as ended:
            parser.parse_args([command, "--help"])
        assert ended.value.code == 0
    for name in re.findall(r"km\.([a-zA-Z_]+)", readme):
        assert name in km.__all__
    for linked in re.findall(r"\]\((?!https?:)([^)#]+)\)", readme):
        assert (Path(__file__).resolve().parents[1] / linked).exists(), linked
