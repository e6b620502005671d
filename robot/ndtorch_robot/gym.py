"""The simulated drives as environments of Gymnasium: after `register()`, `gymnasium.make("ndtorch/Office-v0")`.

What the cameras see in, speed and curvature out.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces

from ndtorch.errors import InputError
from ndtorch.navigation import Strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import ARENAS, load_arena
from ndtorch_robot.sim.disturbances import read_disturbances
from ndtorch_robot.sim.simulation import RIG, CarLimits, Simulation

Pixels = npt.NDArray[np.uint8]
Observation = dict[str, npt.NDArray[Any]]
Action = npt.NDArray[np.float32]

CONTACT = 10.0
"""What touching something costs: as much as 10 m of new ground bring."""

CELL, PASS = 0.5, 3.0
"""New ground is counted in cells of this side, m, each for so many seconds from when it was first entered."""

EPISODE_STEPS = 1800
"""Most steps of an episode, a minute of 30 frames a second; see `max_episode_steps` of `gymnasium.make`."""

ENVIRONMENTS = {"".join(word.capitalize() for word in arena.split("-")): arena for arena in ARENAS}
"""Arenas by the names of their environments; `ndtorch/Drive-v0` takes any `arena`, also a `.toml` file."""


def register() -> None:
    """Make all environments known to Gymnasium; those that are known already stay as they are."""
    wanted = {f"ndtorch/{name}-v0": {"arena": arena} for name, arena in ENVIRONMENTS.items()}
    for name, given in (wanted | {"ndtorch/Drive-v0": {}}).items():
        if name not in gymnasium.registry:
            entry = "ndtorch_robot.gym:DriveEnv"
            gymnasium.register(name, entry_point=entry, max_episode_steps=EPISODE_STEPS, kwargs=given)


class DriveEnv(gymnasium.Env[Observation, Action]):
    """The simulated car in a building, through the same cameras, car and safety layer as `ndtorch drive`.

    - **Observation**: a dictionary. `"strips"` are what navigation reads, the left camera first: `fields`, the patches
      of floor as one image of six channels, uint8 `[6, h, w]`, and `rows`, the six channels of both horizon rows one
      after the other, float32 in 0..1 `[6 * 640]`. `"frames"` are the images `left` and `right`, uint8
      `[3, 480, 640]`, ten times as slow.
    - **Action**: speed, m/s, backward where negative, and curvature, 1/m, positive to the left, for one frame.
    - **Reward**: metres really driven since the last step, less 10 for touching anything, which ends the episode.
      Metres forward count on new ground alone, in cells of half a metre for three seconds from when each was first
      entered; metres backward count negative.
    - **Info**: `pose` (true x, y, m, and heading, radians), `driven` (speed and curvature that the wheels say),
      `time` (s) and `collisions`; a policy may not use it.

    `reset(seed=...)` draws the building, its textures and the start from the seed. A new building takes seconds; with
    `building=N` all episodes are in building N, the `--seed` of `ndtorch drive`, and a reset takes milliseconds.

    Args:
        arena: a name that `ndtorch arenas` lists, or a `.toml` file.
        observation: `"strips"` or `"frames"`.
        controller: whose patch of floor is seen.
        building: number of the only building, or None.
        disturbance: what is wrong with cameras and car, in the words of `ndtorch drive --disturbance`.
        render_mode: None or `"rgb_array"`: `render` gives the left camera's frame.

    Raises:
        InputError: an unknown arena or disturbance.
    """

    simulation: Simulation
    safe: SafeDrive
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012

    def __init__(
        self,
        arena: str = "hallway",
        observation: Literal["strips", "frames"] = "strips",
        controller: str = "ranging",
        building: int | None = None,
        disturbance: str = "",
        render_mode: str | None = None,
    ) -> None:
        if observation not in ("strips", "frames") or render_mode not in (None, "rgb_array"):
            raise InputError(f"no observation {observation!r}, or no render_mode {render_mode!r}")
        load_arena(arena, building or 0)
        self.building, self.disturbances = building, read_disturbances(disturbance)
        self.arena = arena
        self.strips, self.render_mode = observation == "strips", render_mode
        self.fields = NavigatorOptions(controller=controller).fields(RIG)
        field = self.fields[0]
        self.observation_space: Any = spaces.Dict(
            {
                "fields": spaces.Box(0, 255, (6, field.bottom - field.top, field.right - field.left), np.uint8),
                "rows": spaces.Box(0, 1, (6 * RIG.width,), np.float32),
            }
            if self.strips
            else {eye: spaces.Box(0, 255, (3, RIG.height, RIG.width), np.uint8) for eye in ("left", "right")}
        )
        most = np.array(CarLimits()[:2], np.float32)
        self.action_space = spaces.Box(-most, most, dtype=np.float32)
        self.built: int | None = None
        self.entered: dict[tuple[int, int], float] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31))
        building = drawn if self.building is None else self.building
        if self.built != building:
            self.built = building
            self.simulation = Simulation(
                load_arena(self.arena, building),
                building,
                full_frames=not self.strips,
                fields=self.fields,
                disturbances=self.disturbances,
            )
        self.simulation.begin(drawn)
        self.safe = SafeDrive(self.simulation, self.simulation)
        self.entered = {}
        return self.observation(self.simulation.read()), self.info()

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        simulation, hits = self.simulation, len(self.simulation.collisions)
        self.safe.send(DriveCommand(*map(float, action)))
        simulation.wait_until(simulation.now() + 1 / simulation.rate)
        frames = simulation.read()
        hit = len(simulation.collisions) > hits
        # The car's own length, not what its odometer says of it; new ground was first entered a moment ago.
        (x, y, _), now, length = simulation.pose, simulation.now(), simulation.car.length
        entered = self.entered.setdefault((math.floor(x / CELL), math.floor(y / CELL)), now)
        reward = (length if length < 0 or now - entered <= PASS else 0.0) - CONTACT * hit
        return self.observation(frames), reward, hit, False, self.info()

    def observation(self, frames: StereoFrames) -> Observation:
        if not self.strips:
            return {"left": pixels(frames.left), "right": pixels(frames.right)}
        eyes: Any = frames[:2]
        rows = np.concatenate([pixels(strips.row).ravel() for strips in eyes]) / np.float32(255)
        return {"fields": np.concatenate([pixels(strips.field) for strips in eyes]), "rows": rows}

    def info(self) -> dict[str, Any]:
        simulation = self.simulation
        return {
            "pose": np.array(simulation.pose),
            "driven": np.array(simulation.driven()),
            "time": simulation.now(),
            "collisions": len(simulation.collisions),
        }

    def render(self) -> Any:
        """What the left camera sees, `[480, 640, 3]` uint8; None where no `render_mode` was asked for."""
        cameras, pose = self.simulation.cameras, self.simulation.pose
        return None if self.render_mode is None else cameras.frame(cameras.view(*pose, 0)).transpose(1, 2, 0)


def pixels(frames: Any) -> Pixels:
    return np.array(frames[0].numpy(), np.uint8)


def strips_of(observation: Observation) -> tuple[Strips, Strips]:
    """An observation of strips as `Navigator` takes it, of the left and of the right camera."""
    fields = torch.from_numpy(observation["fields"])
    rows = torch.from_numpy(np.rint(255 * observation["rows"]).astype(np.uint8).reshape(6, -1))
    left, right = (Strips(fields[None, eye], rows[None, eye, None]) for eye in (slice(0, 3), slice(3, 6)))
    return left, right
