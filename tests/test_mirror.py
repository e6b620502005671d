"""The tests mirror the tree: a module has its file of tests, or here is said which file tests it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

TESTS = Path(__file__).parent
MIRRORS = {"ndtorch": "", "robot/ndtorch_robot": "robot", "train/ndtorch_train": "train"}

# A module, or a folder for what in it has no file of its own, and the file that tests it.
TESTED_IN = {
    "__main__": "test_commands",
    "command_run": "test_commands",
    "errors": "test_commands",
    "lazy": "test_public_names",
    "optional": "test_commands",
    "toml": "test_config",
    "cli": "test_cli",
    "binding": "binding/test_network",
    "binding/first_stage": "binding/test_first_stage_training",
    "binding/models/kinds": "test_loading",
    "binding/models/whole_field": "binding/models/test_published",
    "binding/readout/params": "test_config",
    "binding/readout/weights": "binding/test_objects",
    "binding/tracking": "binding/tracking/test_tracks",
    "binding/tracking/params": "binding/tracking/test_windows",
    "kernels": "vision/test_one_pass",
    "kernels/folder": "kernels/test_load",
    "kernels/switch": "kernels/test_load",
    "navigation": "navigation/test_navigator",
    "navigation/certainty": "navigation/test_mapping",
    "navigation/correspondence": "navigation/test_row_features",
    "navigation/features": "navigation/test_row_features",
    "navigation/observations": "navigation/test_mapping",
    "navigation/prediction": "navigation/test_row_features",
    "navigation/row_ranging": "navigation/test_ranging",
    "navigation/strips": "robot/sim/test_cameras",
    "navigation/controllers": "navigation/controllers/test_contract",
    "navigation/controllers/ranging": "navigation/controllers/ranging/test_control",
    "navigation/controllers/ranging/arcs": "navigation/controllers/ranging/test_patch",
    "navigation/controllers/ranging/floor_motion": "navigation/controllers/ranging/test_floor",
    "navigation/controllers/ranging/floor_view": "navigation/controllers/ranging/test_floor",
    "report": "report/test_figures",
    "run": "run/test_run",
    "run/opening": "test_cli",
    "scenes": "scenes/test_bar_scenes",
    "scenes/_torchvision": "scenes/test_video",
    "scenes/named": "test_cli",
    "scenes/readers": "scenes/test_video",
    "scenes/video_writer": "scenes/test_video",
    "vision": "vision/test_features",
    "vision/camera": "vision/camera/test_front_end",
    "vision/chahl_srinivasan": "vision/test_nondirectional",
    "vision/paired_grids": "vision/test_one_pass",
    "vision/thinning": "vision/test_orientation",
    "robot": "robot/test_drive",
    "robot/navigating": "robot/recording/test_replay",
    "robot/ports": "robot/test_safety",
    "robot/run": "robot/link/test_registry",
    "robot/run_config": "robot/test_service",
    "robot/calibration": "robot/calibration/test_calibration",
    "robot/cameras": "robot/cameras/test_pair",
    "robot/commands": "robot/test_firmware",
    "robot/commands/arenas": "robot/sim/test_plan",
    "robot/commands/calibrate": "robot/calibration/test_calibration",
    "robot/commands/cameras": "robot/cameras/test_pair",
    "robot/commands/evaluate": "robot/evaluation/test_evaluation",
    "robot/commands/replay": "robot/view/test_car_view",
    "robot/evaluation": "robot/evaluation/test_evaluation",
    "robot/link": "robot/link/test_serial_drive",
    "robot/link/simulated_board": "robot/test_firmware",
    "robot/link/simulated_world": "robot/test_drive",
    "robot/recording": "robot/recording/test_recorder",
    "robot/recording/recorded_car": "robot/recording/test_replay",
    "robot/sim": "robot/sim/test_cameras",
    "robot/sim/arena_file": "robot/sim/test_plan",
    "robot/sim/arenas": "robot/sim/test_plan",
    "robot/sim/board": "robot/test_firmware",
    "robot/sim/generated": "robot/sim/test_plan",
    "robot/sim/places": "robot/sim/test_plan",
    "robot/sim/profiles": "robot/test_score",
    "robot/sim/pulse_world": "robot/test_firmware",
    "robot/sim/put_back": "robot/test_drive",
    "robot/sim/tracing": "robot/sim/test_plan",
    "robot/view": "robot/view/test_car_view",
    "train/first_stage_folder": "test_published",
    "train/recorded": "train/reproduce/test_command",
    "train/reproduce": "train/reproduce/test_command",
    "train/score": "train/score/test_command",
    "train/score/methods": "train/score/test_bars",
    "train/score/video_clips": "train/score/test_video_score",
    "train/score/video_encode": "train/score/test_video_score",
    "train/score/video_paint": "train/score/test_video_score",
    "train/score/whole_field": "train/score/test_video_score",
    "train/sweep": "train/sweep/test_config",
}


def modules() -> Iterator[str]:
    """Every module by its place in the mirror."""
    for folder, place in MIRRORS.items():
        root = TESTS.parent / folder
        for path in root.rglob("*.py"):
            if path.name != "__init__.py":
                yield str(PurePosixPath(place) / path.relative_to(root).with_suffix("").as_posix())


def own(module: str) -> str:
    """The file of tests that a module has by its place."""
    place = PurePosixPath(module)
    return str(place.with_name(f"test_{place.name}"))


def named(module: str) -> str | None:
    """The entry that a module, or the nearest folder around it, has here."""
    return next((str(p) for p in (PurePosixPath(module), *PurePosixPath(module).parents) if str(p) in TESTED_IN), None)


def there(file: str) -> bool:
    """Whether there is such a file of tests."""
    return (TESTS / f"{file}.py").is_file()


def test_every_module_has_its_tests() -> None:
    without = [module for module in modules() if not there(own(module))]
    assert [module for module in without if named(module) is None] == [], "write its file of tests, or name one above"
    assert [file for file in TESTED_IN.values() if not there(file)] == []
    assert sorted(set(TESTED_IN) - {named(module) for module in without}) == [], "named above without need"


def test_tests_lie_where_what_they_test_lies() -> None:
    """A file that is named after no module tests several, or a rule of all, in the folder that it lies in."""
    folders = {str(PurePosixPath(module).parent) for module in modules()} | {".", "golden", "benchmarks"}
    files = [path.relative_to(TESTS) for path in TESTS.rglob("test_*.py")]
    assert sorted(str(file) for file in files if file.parent.as_posix() not in folders) == []
