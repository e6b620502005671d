"""What a drive needs is compiled or loaded before it begins: later the loop would stand still for it."""

import gc
from functools import partial

import pytest

from ndtorch.utils.jit import JitFunction
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.run import open_car
from ndtorch_robot.run_config import NavigationTable, RunConfig, SimulationTable

OPTIONS = (
    NavigationTable(controller="published", map_half_size_m=8.0),
    NavigationTable(controller="ranging"),
    NavigationTable(controller="goal", goal="4,0", stereo="search", localise=True, map_half_size_m=8.0),
)


@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS, ids=("published", "ranging", "goal"))
def test_no_kernel_is_loaded_on_the_way(options, monkeypatch):
    loaded, first = [], JitFunction.first_call

    def told(kernel, *given):
        loaded.append(kernel.function.__name__)
        return first(kernel, *given)

    for kernel in [each for each in gc.get_objects() if type(each) is JitFunction]:
        kernel.run = partial(told, kernel)  # as in a new process
    monkeypatch.setattr(JitFunction, "first_call", told)
    table, world = {"kind": "simulated-world"}, SimulationTable(arena="room", seed=3)
    config = RunConfig(robot="sim", link=table, simulation=world, navigation=options)
    before = []

    def look(step):
        if step.number == 0:
            before.extend(loaded)
        if step.number == 25:
            car.safe.fault("by hand", FaultKind.NOT_STARTED)
        if step.number == 28:  # it stands, looks at what is near, and drives on
            car.safe.resume()

    with open_car(config, lambda line: None, True, [look]) as car:
        car.run(1.8)
        assert car.runner.state is not None
        assert max(float(part) for part in car.runner.state.pose[:2]) > 0.2  # it has driven
    assert len(car.safe.faults) > 1
    assert before
    assert loaded == before
