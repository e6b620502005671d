"""The animation at the top of README.md: `python docs/readme_animation.py models/pictures/ndtorch.gif`.

Left: a drawn film with the objects that `ndtorch bind` finds in it. Right: the path of a simulated car that explores an
office, as by `ndtorch drive`, and last the map that it drew.
"""

import sys
import tempfile

import cv2
import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ndtorch.cli.commands import main
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.evaluation.plots import draw_cells, draw_plan

PICTURES, HELD, FRAME_MS, DRIVEN_S = 40, 10, 200, 80.0
SIZE, FPS, EVERY = (360, 280), 20.0, 4
COLORS = {"red": (0.8, 0.1, 0.1), "green": (0.1, 0.6, 0.2), "blue": (0.1, 0.25, 0.8), "yellow": (0.85, 0.75, 0.1)}


def marked_film() -> list[np.ndarray]:
    """Four discs on a rough ground, marked where they were found, `[H, W, 3]` each."""
    generator, (height, width) = torch.Generator().manual_seed(0), SIZE
    rough = torch.rand(1, 1, height // 12, width // 12, generator=generator)
    ground = 0.3 + 0.3 * torch.nn.functional.interpolate(rough, SIZE, mode="bicubic")[0].expand(3, *SIZE)
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    with tempfile.TemporaryDirectory() as folder:
        with VideoWriter(f"{folder}/discs.mkv", FPS, SIZE) as film:
            for n in range(EVERY * PICTURES):
                frame = ground.clone()
                for k, color in enumerate(COLORS.values()):
                    x = (1.7 + 0.3 * k) * (n - 8 * k) - 60
                    column, row = (x, width - x)[k % 2], 60 + 80 * k + 18 * np.sin(n / (9 + 3 * k))
                    frame[:, (columns - column) ** 2 + (rows - row) ** 2 < 22**2] = torch.tensor(color)[:, None]
                film.write((frame + 0.01 * torch.randn(frame.shape, generator=generator)).clamp(0, 1))
        main(["bind", f"{folder}/discs.mkv", "--out", folder, "--pictures", str(FPS / EVERY)])
        overlay, pictures = cv2.VideoCapture(f"{folder}/discs/overlay.mp4"), []
        while (read := overlay.read())[0]:
            pictures.append(read[1][..., ::-1])
    return pictures


if __name__ == "__main__":
    pictures = marked_film()
    result = drive(DriveConfig(arena="office", controller="goal", explore=True, seconds=DRIVEN_S))
    path, times = result.record.track(), result.record.array("time")
    figure = Figure((8.4, 4.2), dpi=85, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
    shown = left.imshow(pictures[0])
    left.set(xticks=[], yticks=[], title="objects found in a film")
    draw_plan(right, result.plan)
    (line,) = right.plot([], [], color="#0072b2", lw=2, zorder=4)
    (car,) = right.plot([], [], "D", color="#222222", ms=7, zorder=5)
    images = []
    for n in range(PICTURES + HELD):
        shown.set_data(pictures[min(n, len(pictures) - 1)])
        upto = max(1, round(min(1.0, (n + 1) / PICTURES) * len(path)))
        line.set_data(*path[:upto].T)
        car.set_data(*path[upto - 1 : upto].T)
        right.set_title(f"path of a simulated car with two cameras, {times[upto - 1]:.0f} s")
        if n == PICTURES:
            cells, (west, east, south, north) = result.cells.numpy(), result.plan.bounds
            draw_cells(right, cells, result.plan.grid(), max(1, round(max(cells.shape) / 700)))
            right.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5))
        if n >= PICTURES:
            right.set_title("and the map that it drew, in red")
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(96, dither=Image.Dither.NONE))
    images[0].save(sys.argv[1], save_all=True, append_images=images[1:], duration=FRAME_MS, loop=0)
