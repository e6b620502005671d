"""A cable that fails in every way of a soak."""

from ndtorch_robot.soak.cable import FailingCable


class NoWorld:
    up = down = None


def test_a_bad_cable_is_bad():
    world, data = NoWorld(), bytes(range(256)) * 8
    cable = FailingCable(world, 1)
    cable.fail("cable pulled")
    assert world.up(data, 0.0) == world.down(data, 0.0) == b""
    cable.fail("everything late on the way there")
    assert world.up(data, 0.0) == b""
    assert world.up(b"", 0.31) == data
    cable.fail("a third damaged on the way back")
    wrong = sum(a != b for a, b in zip(world.down(data, 0.0), data, strict=True))
    assert 30 < wrong < 100
    assert world.up(data, 0.0) == data
    cable.mend()
    assert world.down(data, 0.0) == data
