"""When a car looks at what is right ahead of it, and who is told."""

import pytest
import torch

from ndtorch.navigation import Command, Navigator, StereoRig
from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED
from ndtorch.navigation.stereo.search import SearchParams

RIG = StereoRig()


def navigator(**options):
    return Navigator(RIG, 1 / 30, near_check=True, **options)


def started(car):
    eyes = torch.randint(0, 256, (2, 1, 3, RIG.height, RIG.width), generator=torch.Generator().manual_seed(4))
    return car(*eyes.to(torch.uint8))[1]


def driven(speed):
    return Command(speed, 0.0)


@pytest.mark.parametrize(("speed", "begins", "due"), [(0.0, True, True), (0.04, True, True), (0.06, True, False)])
def test_a_car_that_begins_looks_while_it_stands(speed, begins, due):
    car = navigator()
    assert car.near.due(car.controller, driven(speed), started(car).control, begins) == due


def test_a_car_that_stands_looks_again_only_where_its_controller_holds_it():
    car = navigator()
    control = started(car).control
    held = (control._replace(mode=mode) for mode in car.controller.modes)
    looks = [
        mode
        for mode, state in zip(car.controller.modes, held, strict=True)
        if car.near.due(car.controller, driven(0.0), state, False)
    ]
    assert looks == [SUPPRESSED, STOPPED]


def test_it_searches_only_where_the_ranging_does_not():
    assert navigator().near.searching is not None
    assert navigator(search=SearchParams()).near.searching is None
    assert Navigator(RIG, 1 / 30).near is None
    assert Navigator(RIG, 1 / 30, controller="published", near_check=True).near is None
