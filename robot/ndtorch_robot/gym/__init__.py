"""The simulated drives as environments of Gymnasium: `gymnasium.make("ndtorch/Office-v0")`.

Where `ndtorch-robot[sim]` is installed, Gymnasium finds them by itself (entry points `gymnasium.envs`). `register` does
the same in a checkout that is not installed. Only Gymnasium is imported for that.
"""

from __future__ import annotations

ENVIRONMENTS = {
    "Hallway": "hallway",
    "Curve": "curve",
    "Loop": "loop",
    "Room": "room",
    "Office": "office",
    "Random": "random",
}
"""Arenas by the names of their environments; `ndtorch/Drive-v0` takes any `arena`, and those of a `.toml` file too."""


def register() -> None:
    """Make all environments known to Gymnasium; those that are known already stay as they are."""
    from gymnasium.envs import registration

    wanted = {f"ndtorch/{name}-v0": {"arena": arena} for name, arena in ENVIRONMENTS.items()}
    for name, given in (wanted | {"ndtorch/Drive-v0": {}}).items():
        if name not in registration.registry:
            registration.register(name, entry_point="ndtorch_robot.gym.environment:DriveEnv", kwargs=given)
