"""The tests mirror the tree: a module has its file of tests, or here is said which file tests it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

TESTS = Path(__file__).parent
MIRRORS = {"ndtorch": "", "robot/ndtorch_robot": "robot", "train/ndtorch_train": "train"}

# Every module without a file of its own, and the file that tests it.
TESTED_IN = {
    "__main__": "test_commands",
    "command_run": "test_commands",
    "errors": "test_commands",
    "lazy": "test_public_names",
    "optional": "test_commands",
    "toml": "test_config",
    "binding/first_stage": "binding/test_first_stage_training",
    "binding/learning": "binding/test_network",
    "binding/models/figures_state": "binding/models/test_figures",
    "binding/models/kinds": "test_loading",
    "binding/models/whole_field": "binding/models/test_published",
    "binding/readout/params": "test_config",
    "binding/readout/weights": "binding/test_objects",
    "binding/tracking/detections": "binding/tracking/test_tracks",
    "binding/tracking/figure_params": "binding/models/test_figures",
    "binding/tracking/figures": "binding/models/test_figures",
    "binding/tracking/following": "binding/models/test_figures",
    "binding/tracking/meeting": "binding/models/test_figures",
    "binding/tracking/params": "binding/tracking/test_windows",
    "binding/tracking/regions": "binding/models/test_figures",
    "binding/tracking/silhouettes": "binding/models/test_figures",
    "binding/tracking/tracker": "binding/tracking/test_tracks",
    "cli/bind": "test_cli",
    "cli/render": "test_cli",
    "cli/scenes": "test_cli",
    "kernels/arc": "navigation/test_odometry",
    "kernels/avoidance": "navigation/test_kernels",
    "kernels/beam_cells": "navigation/test_kernels",
    "kernels/cell_maxima": "navigation/test_kernels",
    "kernels/cost_to_go": "navigation/controllers/goal/test_planning",
    "kernels/decision": "navigation/test_kernels",
    "kernels/filters": "vision/test_one_pass",
    "kernels/find_way": "navigation/controllers/goal/test_planning",
    "kernels/floor_cells": "navigation/test_kernels",
    "kernels/folder": "kernels/test_load",
    "kernels/front_end": "vision/test_one_pass",
    "kernels/pair_spectrum": "vision/test_one_pass",
    "kernels/pair_sums": "vision/test_one_pass",
    "kernels/patch_arcs": "navigation/test_kernels",
    "kernels/published_step": "navigation/test_kernels",
    "kernels/ranging_control": "navigation/test_kernels",
    "kernels/ranging_step": "navigation/test_kernels",
    "kernels/row_features": "navigation/test_kernels",
    "kernels/row_ranges": "navigation/test_kernels",
    "kernels/search_row": "navigation/test_row_search",
    "kernels/strips": "navigation/test_kernels",
    "kernels/switch": "kernels/test_load",
    "kernels/tile_sums": "navigation/test_tiles",
    "kernels/ways": "navigation/controllers/goal/test_planning",
    "navigation/certainty": "navigation/test_mapping",
    "navigation/controllers/goal/control": "navigation/controllers/goal/test_goal_control",
    "navigation/controllers/goal/following": "navigation/controllers/goal/test_planning",
    "navigation/controllers/goal/memory": "navigation/controllers/goal/test_goal_control",
    "navigation/controllers/goal/params": "navigation/controllers/goal/test_goal_control",
    "navigation/controllers/goal/speeds": "navigation/controllers/goal/test_goal_control",
    "navigation/controllers/goal/state": "navigation/controllers/goal/test_goal_control",
    "navigation/controllers/published_quick": "navigation/test_kernels",
    "navigation/controllers/quick": "navigation/test_kernels",
    "navigation/controllers/ranging/arcs": "navigation/controllers/ranging/test_patch",
    "navigation/controllers/ranging/decision": "navigation/controllers/ranging/test_control",
    "navigation/controllers/ranging/floor_motion": "navigation/controllers/ranging/test_floor",
    "navigation/controllers/ranging/floor_view": "navigation/controllers/ranging/test_floor",
    "navigation/controllers/ranging/modes": "navigation/controllers/ranging/test_control",
    "navigation/controllers/ranging/params": "navigation/controllers/ranging/test_control",
    "navigation/controllers/ranging/quick": "navigation/test_kernels",
    "navigation/controllers/registry": "navigation/controllers/test_contract",
    "navigation/controllers/subfields": "navigation/test_kernels",
    "navigation/correspondence": "navigation/test_row_features",
    "navigation/features": "navigation/test_row_features",
    "navigation/model": "navigation/test_navigator",
    "navigation/observations": "navigation/test_mapping",
    "navigation/prediction": "navigation/test_row_features",
    "navigation/row_ranging": "navigation/test_ranging",
    "navigation/strip_kernels": "navigation/test_kernels",
    "navigation/whole_step": "navigation/test_kernels",
    "navigation/strips": "robot/sim/test_cameras",
    "report/figures/attention": "report/test_figures",
    "report/figures/layout": "report/test_figures",
    "report/figures/outputs": "report/test_figures",
    "report/figures/traces": "report/test_figures",
    "report/figures/weights": "report/test_figures",
    "report/folder": "test_cli",
    "report/palette": "report/test_figures",
    "report/run_page": "report/test_page",
    "run/arguments": "test_commands",
    "run/opening": "test_cli",
    "run/pictures": "run/test_run",
    "run/progress": "test_cli",
    "run/result": "run/test_run",
    "run/watchers": "run/test_run",
    "scenes/_torchvision": "scenes/test_video",
    "scenes/base": "scenes/test_gratings",
    "scenes/file_checks": "scenes/test_video",
    "scenes/named": "test_cli",
    "scenes/parameters": "scenes/test_bar_scenes",
    "scenes/quiet": "scenes/test_video",
    "scenes/readers": "scenes/test_video",
    "scenes/rendered": "scenes/test_bar_scenes",
    "scenes/tuning": "train/reproduce/test_command",
    "scenes/video_writer": "scenes/test_video",
    "vision/camera/figure_signals": "binding/models/test_figures",
    "vision/camera/figures": "binding/models/test_figures",
    "vision/camera/params": "vision/camera/test_front_end",
    "vision/camera/sampling": "vision/camera/test_front_end",
    "vision/chahl_srinivasan": "vision/test_nondirectional",
    "vision/paired_grids": "vision/test_one_pass",
    "vision/roots": "test_gradients",
    "vision/thinning": "vision/test_orientation",
    "robot/agreement": "robot/test_watch",
    "robot/barn/attempt": "robot/barn/test_barn",
    "robot/barn/results": "robot/barn/test_barn",
    "robot/barn/worlds": "robot/barn/test_barn",
    "robot/calibration/board": "robot/calibration/test_calibration",
    "robot/calibration/collect": "robot/calibration/test_calibration",
    "robot/calibration/model": "robot/calibration/test_calibration",
    "robot/calibration/rectify": "robot/calibration/test_calibration",
    "robot/calibration/solve": "robot/calibration/test_calibration",
    "robot/cameras/measure": "robot/cameras/test_pair",
    "robot/cameras/opening": "robot/cameras/test_pair",
    "robot/cameras/pairing": "robot/cameras/test_pair",
    "robot/cameras/reader": "robot/cameras/test_pair",
    "robot/cameras/settings": "robot/cameras/test_pair",
    "robot/cameras/sysfs": "robot/cameras/test_pair",
    "robot/commands/arenas": "robot/sim/test_plan",
    "robot/commands/calibrate": "robot/calibration/test_calibration",
    "robot/commands/cameras": "robot/cameras/test_pair",
    "robot/commands/check": "robot/test_firmware",
    "robot/commands/evaluate": "robot/evaluation/test_evaluation",
    "robot/commands/replay": "robot/view/test_car_view",
    "robot/config": "robot/commands/test_drive",
    "robot/evaluation/drives": "robot/evaluation/test_evaluation",
    "robot/evaluation/picture": "robot/evaluation/test_evaluation",
    "robot/evaluation/table": "robot/evaluation/test_evaluation",
    "robot/eye": "robot/test_sight",
    "robot/figures": "robot/commands/test_drive",
    "robot/link/hearing": "robot/link/test_serial_drive",
    "robot/link/line": "robot/link/test_serial_drive",
    "robot/link/parser": "robot/link/test_messages",
    "robot/link/port": "robot/link/test_serial_drive",
    "robot/link/simulated_board": "robot/test_firmware",
    "robot/link/simulated_world": "robot/test_drive",
    "robot/navigating": "robot/recording/test_replay",
    "robot/ports": "robot/test_safety",
    "robot/record": "robot/test_drive",
    "robot/recording/observe": "robot/recording/test_recorder",
    "robot/recording/reading": "robot/recording/test_replay",
    "robot/recording/recorded_car": "robot/recording/test_replay",
    "robot/recording/streams": "robot/recording/test_recorder",
    "robot/report": "robot/commands/test_drive",
    "robot/run": "robot/link/test_registry",
    "robot/run_config": "robot/test_service",
    "robot/sim/arena_file": "robot/sim/test_plan",
    "robot/sim/arenas": "robot/sim/test_plan",
    "robot/sim/board": "robot/test_firmware",
    "robot/sim/generated": "robot/sim/test_plan",
    "robot/sim/gl": "robot/commands/test_drive",
    "robot/sim/mesh": "robot/sim/test_cameras",
    "robot/sim/model": "robot/sim/test_cameras",
    "robot/sim/paint": "robot/sim/test_cameras",
    "robot/sim/places": "robot/sim/test_plan",
    "robot/sim/profiles": "robot/test_score",
    "robot/sim/pulse_world": "robot/test_firmware",
    "robot/sim/put_back": "robot/test_drive",
    "robot/sim/simulation": "robot/sim/test_cameras",
    "robot/sim/tracing": "robot/sim/test_plan",
    "robot/view/background": "robot/view/test_car_view",
    "robot/view/drawing": "robot/view/test_car_view",
    "robot/view/opening": "robot/view/test_car_view",
    "robot/view/steps": "robot/view/test_car_view",
    "train/first_stage_folder": "test_published",
    "train/recorded": "train/reproduce/test_command",
    "train/reproduce/bars": "train/reproduce/test_command",
    "train/reproduce/drives": "train/reproduce/test_command",
    "train/reproduce/driving": "train/reproduce/test_command",
    "train/reproduce/first_stage": "train/reproduce/test_command",
    "train/reproduce/mapping": "train/reproduce/test_command",
    "train/reproduce/mixtures": "train/reproduce/test_command",
    "train/reproduce/objects": "train/reproduce/test_command",
    "train/reproduce/plots": "train/reproduce/test_command",
    "train/reproduce/sensors": "train/reproduce/test_command",
    "train/reproduce/signals": "train/reproduce/test_command",
    "train/reproduce/two_neurons": "train/reproduce/test_command",
    "train/reproduce/video": "train/reproduce/test_command",
    "train/score/benchmark": "train/score/test_command",
    "train/score/choices": "train/score/test_command",
    "train/score/figure": "train/score/test_command",
    "train/score/labelled/command": "train/score/test_labelled",
    "train/score/labelled/methods": "train/score/test_labelled",
    "train/score/labelled/metrics": "train/score/test_metrics",
    "train/score/labelled/peers": "train/score/test_labelled",
    "train/score/labelled/sight": "train/score/test_labelled",
    "train/score/labelled/table": "train/score/test_labelled",
    "train/score/labelled/truth": "train/score/test_truth",
    "train/score/leaderboard": "train/score/test_command",
    "train/score/methods": "train/score/test_bars",
    "train/score/named": "train/score/test_peers",
    "train/score/report": "train/score/test_command",
    "train/score/video_clips": "train/score/test_video_score",
    "train/score/video_command": "train/score/test_video_score",
    "train/score/video_encode": "train/score/test_video_score",
    "train/score/video_paint": "train/score/test_video_score",
    "train/score/whole_field": "train/score/test_video_score",
    "train/sweep/parameters": "train/sweep/test_config",
}

NOT_TESTED = {
    "robot/commands/barn",
    "robot/commands/run",
    "train/score/local_bars",
    "train/score/retinotopic",
}
"""Modules that no file of tests is about yet. Do not add to them."""


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


def there(file: str) -> bool:
    """Whether there is such a file of tests."""
    return (TESTS / f"{file}.py").is_file()


def test_every_module_has_its_tests() -> None:
    without = {module for module in modules() if not there(own(module))}
    assert sorted(without - set(TESTED_IN) - NOT_TESTED) == [], "write its file of tests, or name the one that has them"
    assert sorted(file for file in TESTED_IN.values() if not there(file)) == []
    assert sorted((set(TESTED_IN) | NOT_TESTED) - without) == [], "named above without need"
    assert sorted(set(TESTED_IN) & NOT_TESTED) == []


def test_tests_lie_where_what_they_test_lies() -> None:
    """A file that is named after no module tests several, or a rule of all, in the folder that it lies in."""
    folders = {str(PurePosixPath(module).parent) for module in modules()} | {".", "golden", "benchmarks"}
    files = [path.relative_to(TESTS) for path in TESTS.rglob("test_*.py")]
    assert sorted(str(file) for file in files if file.parent.as_posix() not in folders) == []
