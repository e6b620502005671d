"""The simulated drives as environments of Gymnasium: after `register()`, `gymnasium.make("ndtorch/Office-v0")`.

Since Gymnasium 1.0 environments are found only after such a call. It imports Gymnasium alone.
"""

from __future__ import annotations

BUILDINGS = ("hallway", "curve", "loop", "room", "office", "random")
TESTS = (
    "tiles",
    "checker",
    "smooth",
    "lines",
    "chairs",
    "slalom",
    "sofa",
    "dead-end",
    "door-61",
    "door-81",
    "t-junction",
)
ARENAS = BUILDINGS + TESTS
"""Arenas with an environment of their own, written out so that Gymnasium need not import the simulator to know them."""

ENVIRONMENTS = {"".join(word.capitalize() for word in arena.split("-")): arena for arena in ARENAS}
"""Arenas by the names of their environments; `ndtorch/Drive-v0` takes any `arena`, and those of a `.toml` file too."""


EPISODE_STEPS = 1800
"""Steps of an episode at most, a minute of 30 frames a second; `max_episode_steps` of `gymnasium.make` changes it."""


def register() -> None:
    """Make all environments known to Gymnasium; those that are known already stay as they are."""
    from gymnasium.envs import registration

    wanted = {f"ndtorch/{name}-v0": {"arena": arena} for name, arena in ENVIRONMENTS.items()}
    for name, given in (wanted | {"ndtorch/Drive-v0": {}}).items():
        if name not in registration.registry:
            entry = "ndtorch_robot.gym.environment:DriveEnv"
            registration.register(name, entry_point=entry, max_episode_steps=EPISODE_STEPS, kwargs=given)
