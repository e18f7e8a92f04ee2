"""The package's front door: its names exist, and nothing heavy loads before it is used."""

from __future__ import annotations

import subprocess
import sys

import kumitate as km


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
