"""Each fault of the link damages, loses or delays what it says, in one direction or both."""

from tests.fault_injection.link_faults import FaultyLink


class NoWorld:
    up = down = None


def test_link_faults():
    world, data = NoWorld(), bytes(range(256)) * 8
    link = FaultyLink(world, 1)
    link.inject("cable pulled")
    assert world.up(data, 0.0) == world.down(data, 0.0) == b""
    link.inject("bytes to the board delayed")
    assert world.up(data, 0.0) == b""
    assert world.up(b"", 0.31) == data
    link.inject("3 % of bytes from the board damaged")
    wrong = sum(a != b for a, b in zip(world.down(data, 0.0), data, strict=True))
    assert 30 < wrong < 100
    assert world.up(data, 0.0) == data
    link.clear()
    assert world.down(data, 0.0) == data
