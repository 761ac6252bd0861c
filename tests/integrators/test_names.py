"""Methods and peers are found by id; another name from the literature raises an error that suggests the id."""

from __future__ import annotations

import pytest

import phasebench as pb
from phasebench.integrators.names import ALIASES, normalize
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import BY_ID as PEERS


@pytest.mark.parametrize(
    ("name", "meant"),
    [("yoshida-4", "forest-ruth"), ("velocity_verlet", "stormer-verlet"), ("Störmer-Verlet", "stormer-verlet")]
    + [("RK4", "rk4"), ("leapfrog", "stormer-verlet"), ("strang", "stormer-verlet"), ("mclachlan", "mclachlan-ss5")],
)
def test_names_of_the_field_are_suggested_and_not_taken(name, meant):
    for ask in (pb.method, pb.METHODS.__getitem__, pb.integrator):
        with pytest.raises(pb.InvalidInput, match="did you mean") as told:
            ask(name)
        assert meant in str(told.value).partition("did you mean ")[2].rstrip("?").split(" or ")


def test_aliases_name_what_exists_and_are_no_ids():
    assert {id for ids in ALIASES.values() for id in ids} <= {*BY_ID, *PEERS}
    assert all(normalize(name) == name for name in ALIASES)
    assert not {normalize(id) for id in BY_ID} & {*ALIASES}


def test_records_go_by_id_and_by_position():
    assert pb.METHODS["rk4"] is pb.method("rk4")
    assert pb.PEERS["heyoka"].id == "heyoka"
    assert "rk4" in pb.METHODS
    assert "heyoka" not in pb.METHODS
    assert pb.METHODS[0] in pb.METHODS
    assert [m.id for m in pb.METHODS[:2]] == [m.id for m in pb.METHODS][:2]
    with pytest.raises(pb.InvalidInput, match="no peer 'rk4'"):
        pb.PEERS["rk4"]
