"""A mark for tests that draw: skipped, with the reason, where OpenGL does not work."""

import pytest


def reason():
    try:
        import mujoco  # noqa: F401

        from ndtorch_robot.sim.gl import make_context

        make_context(16, 16).free()
    except Exception as error:
        return f"cannot draw here: {error}"
    return ""


WHY = reason()
needs_gl = pytest.mark.skipif(bool(WHY), reason=WHY)
