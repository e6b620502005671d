"""Files of a calibration: what is written is read, and what cannot be used is said."""

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.calibration import read_calibration, write_calibration
from tests.robot.support.misaligned import measured


def test_file_round_trip(tmp_path):
    path = tmp_path / "deep" / "pair.toml"
    write_calibration(measured(), path)
    assert read_calibration(path) == measured()
    text = path.read_text()
    assert "baseline" not in text.splitlines()[1]
    assert all(key in text for key in ("width_px", "translation_m", "rotation_rad", "fx_px", "[quality]", "row_px"))
    with pytest.raises(InputError, match="cannot write the calibration"):
        write_calibration(measured(), tmp_path / "deep" / "pair.toml" / "x.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx_px = 4", "fx_px = -4", "fx_px"),
        ("width_px = 640", "width_px = 640\nwidth = 3", "unknown key 'width'"),
        ('calibration 1"', 'calibration 9"', "format"),
    ],
)
def test_bad_files(tmp_path, old, new, message):
    path = tmp_path / "pair.toml"
    write_calibration(measured(), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_calibration(path)
