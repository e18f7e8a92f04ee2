"""Fixtures that every room's tests share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20260701)


@pytest.fixture(scope="session")
def paper_objects() -> Path:
    """Folder of the paper's meshes, which are no part of the project: KUMITATE_OBJECTS, or one beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "objects"
    folder = Path(os.environ.get("KUMITATE_OBJECTS", beside))
    if not (folder / "housing.stl").is_file():
        pytest.skip("the paper's meshes are not here; KUMITATE_OBJECTS names their folder")
    return folder
