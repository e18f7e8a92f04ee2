"""The knobs have the paper's defaults and refuse what makes no sense."""

from dataclasses import fields
from math import nan, radians

import pytest

from kumitate.errors import InputError
from kumitate.grasping.parameters import GraspParameters


def test_defaults_are_the_papers():
    p = GraspParameters()
    angles = (p.theta_pln, p.theta_fct, p.theta_parl)
    assert angles == pytest.approx((radians(20), radians(20), radians(160)))
    assert (p.t_bdry, p.t_rnn, p.h_max, p.t_dct) == pytest.approx((0.002, 0.003, 0.0015, 0.003))
    assert p.n_da == 8


@pytest.mark.parametrize("name", [item.name for item in fields(GraspParameters)])
@pytest.mark.parametrize("value", [-1.0, 1e3, nan, "2 mm", None, True])
def test_refuses_what_is_out_of_range_by_name(name, value):
    with pytest.raises(InputError, match=rf"^{name}: .*give .* from .* to "):
        GraspParameters(**{name: value})


def test_rotations_are_whole():
    with pytest.raises(InputError, match="n_da"):
        GraspParameters(n_da=7.5)


def test_zero_is_allowed_where_the_paper_uses_it():
    assert GraspParameters(theta_pln=0.0, theta_fct=0.0, t_bdry=0.0, t_dct=0.0, h_max=0.0).t_dct == 0.0
