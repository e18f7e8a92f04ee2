"""Laws of the sampled disabled collisions, on chains whose answer is plain to see and on the shipped robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import kumitate.robots.library
from kumitate.robots.allowed import disabled_collisions
from kumitate.robots.library import make_models

LIBRARY = Path(kumitate.robots.library.__file__).parent


def chain(lengths: list[float], limit: float, folder: Path) -> tuple[pin.Model, pin.GeometryModel]:
    """Bars along x, one after the other, on joints about z; the links are bar0, bar1, ..."""
    links, joints = [], []
    for i, length in enumerate(lengths):
        shape = f'<origin xyz="{length / 2} 0 0"/><geometry><box size="{0.9 * length} 0.02 0.02"/></geometry>'
        links.append(f'<link name="bar{i}"><collision>{shape}</collision></link>')
        if i:
            joints.append(
                f'<joint name="j{i}" type="revolute"><parent link="bar{i - 1}"/><child link="bar{i}"/>'
                f'<origin xyz="{lengths[i - 1]} 0 0"/><axis xyz="0 0 1"/>'
                f'<limit lower="{-limit}" upper="{limit}" velocity="1" effort="1"/></joint>'
            )
    path = folder / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(links)}{"".join(joints)}</robot>')
    model = pin.buildModelFromUrdf(str(path))
    return model, pin.buildGeomFromUrdf(model, str(path), pin.COLLISION)


def test_neighbours_are_adjacent_and_stiff_chains_never_fold_back(tmp_path):
    found = disabled_collisions(*chain([0.2, 0.2, 0.2], limit=0.5, folder=tmp_path), samples=500)
    assert found == [("bar0", "bar1", "Adjacent"), ("bar0", "bar2", "Never"), ("bar1", "bar2", "Adjacent")]


def test_a_chain_that_folds_back_stays_enabled(tmp_path):
    found = disabled_collisions(*chain([0.2, 0.2, 0.3], limit=2.6, folder=tmp_path), samples=2000)
    assert [pair[:2] for pair in found] == [("bar0", "bar1"), ("bar1", "bar2")]


def test_a_pocket_at_the_limits_is_found(tmp_path):
    # The last bar comes back to the first only where all joints stand within a degree or two of their limit.
    found = disabled_collisions(
        *chain([0.2, 0.2, 0.15, 0.2005], limit=np.pi / 2, folder=tmp_path), samples=500, clearance=0.0
    )
    assert ("bar0", "bar3", "Never") not in found


def test_pairs_with_many_joints_between_stay_enabled(tmp_path):
    found = disabled_collisions(*chain([0.5, 0.1, 0.1, 0.1, 0.1, 0.1], limit=0.1, folder=tmp_path), samples=200)
    pairs = [pair[:2] for pair in found]
    assert ("bar0", "bar4") in pairs
    assert ("bar0", "bar5") not in pairs


def test_the_seed_decides_the_answer_and_the_geometry_is_left_alone(tmp_path):
    model, geometry = chain([0.2, 0.2, 0.2, 0.2], limit=1.2, folder=tmp_path)
    first = disabled_collisions(model, geometry, samples=300, seed=3)
    assert first == disabled_collisions(model, geometry, samples=300, seed=3)
    assert len(geometry.collisionPairs) == 0


@pytest.mark.parametrize("name", ["nextage", "ur3_dual", "hrp5p"])
def test_shipped_pairs_called_never_keep_clear_in_other_states(name, rng):
    path = str(LIBRARY / f"{name}.urdf")
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(model, path, pin.COLLISION, package_dirs=[str(make_models.SHARE)])
    geometry.addAllCollisionPairs()
    everything = _link_pairs(model, geometry)
    kept = pin.GeometryModel(geometry)
    pin.removeCollisionPairs(model, kept, str(LIBRARY / f"{name}.srdf"))
    disabled = everything - _link_pairs(model, kept)
    assert disabled
    assert not [pair for pair in disabled if {link.split("_")[0] for link in pair} == {"left", "right"}]

    pairs = [(p.first, p.second) for p in geometry.collisionPairs]
    never = set(_never(LIBRARY / f"{name}.srdf"))
    geometry.removeAllCollisionPairs()
    for i, j in pairs:
        if _links(model, geometry, i, j) in never:
            geometry.addCollisionPair(pin.CollisionPair(i, j))
    assert len(geometry.collisionPairs) >= len(never) > 0
    data, geometry_data = model.createData(), pin.GeometryData(geometry)
    for _ in range(500):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        assert not pin.computeCollisions(model, data, geometry, geometry_data, q, True)


def _links(model: pin.Model, geometry: pin.GeometryModel, i: int, j: int) -> frozenset[str]:
    return frozenset(model.frames[geometry.geometryObjects[k].parentFrame].name for k in (i, j))


def _link_pairs(model: pin.Model, geometry: pin.GeometryModel) -> set[frozenset[str]]:
    return {_links(model, geometry, int(p.first), int(p.second)) for p in geometry.collisionPairs}


def _never(srdf: Path) -> list[frozenset[str]]:
    lines = [line.split('"') for line in srdf.read_text().splitlines() if 'reason="Never"' in line]
    return [frozenset((words[1], words[3])) for words in lines]
