"""Terminal laws out of range are errors at the receiver that name the sending body."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from rich.console import Console

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.run.screen import print_death
from palpate.launch.testing import FakeBus
from palpate.messages import Proximity, Surface
from palpate.nodes.base import InputError, SettingError
from palpate.nodes.base.mesh_file import read_mesh
from palpate.nodes.contact import Series

GOOD = Surface(
    nodes=[], displacement=np.zeros((0, 3)), stiffness=3e3, exponent=1.5, damping=5.0,
    rest_indentation=0.0, previous_indentation=0.0,
    source="liver", tick=4,
)  # fmt: skip
NEAR = Proximity(foot=(0, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0, approach=4e-3, slip=(0, 0, 0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stiffness", -5.0), ("stiffness", 0.0), ("stiffness", math.inf), ("stiffness", math.nan), ("exponent", -1.0),
        ("exponent", 0.99), ("exponent", 3.5), ("damping", -1e-3),
        ("rest_indentation", -1.0), ("rest_indentation", math.nan),
        ("previous_indentation", math.inf), ("step", -1e-3), ("relaxation", math.nan),
    ],
)  # fmt: skip
def test_a_law_out_of_range_is_an_error_with_sender_and_value(name, value):
    wrong = msgspec.structs.replace(GOOD, **{name: value})
    bus = FakeBus(Series(), body=wrong)
    with pytest.raises(
        InputError, match=rf"Surface of 'liver' at tick 4: {name} \[.*found {value}, expected"
    ) as raised:
        bus.publish(NEAR)
    assert raised.value.source == "liver"


@pytest.mark.parametrize(
    "given", [{}, {"rest_indentation": -1e-3}, {"exponent": 3.0}, {"stiffness": 1e12}, {"damping": 0.0}]
)
def test_a_law_within_its_range_is_accepted(given):
    (answer,) = FakeBus(Series(), body=msgspec.structs.replace(GOOD, **given)).publish(NEAR)
    assert answer.force > 0


@pytest.mark.parametrize("place", ["fused", None])
def test_a_run_ends_and_names_the_body_without_a_traceback(place):
    launch = find("kidney").but(place=place, duration=0.2, overrides=("tissue.use=nodes_with_wrong_laws.Bouncy",))
    result = execute(dataclasses.replace(launch, record=None)).result
    assert not result.ok
    death = result.deaths[0]
    assert death.node == "tissue" and "'contact'" in death.where
    assert "Surface of 'tissue' at tick 19: stiffness [N/m^n]: found -5.0, expected a finite number > 0" in death.text
    console = Console(record=True, width=200)
    print_death(death, console)
    assert "Traceback" not in console.export_text()


def test_a_mesh_without_area_is_an_error(tmp_path):
    path = tmp_path / "flat.obj"
    path.write_text("".join(f"v {x} {2 * x} 0\n" for x in (0.0, 0.01, 0.02, 0.05)) + "f 1 2 3\nf 2 3 4\n")
    with pytest.raises(SettingError, match="no area"):
        read_mesh(str(path), 1.0)
