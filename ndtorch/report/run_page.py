"""The report of a binding run."""

from __future__ import annotations

from pathlib import Path

from ndtorch.binding import BoundObject
from ndtorch.report.page import Page, Shown, Table, command_line, versions
from ndtorch.report.words import NOTHING_LEARNED, VERDICTS, numbered, words
from ndtorch.run.result import RunResult
from ndtorch.vision import FEATURES

SHOWN = (
    ("overlay.mp4", "The video, objects marked", "A circle or box in its color, its number, its color in "
     "words, an arrow where it moves, and the clock. What was in sight for a moment has a number, but is no object."),
    ("timeline.png", "Objects over time", "Above: a lane an object, thick while it is in sight. Below: where it went."),
    ("enhanced.mp4", "Input and attention", "Left: what the model sees. Right: the same, weighted by the features of "
     "the winning neuron, brightened as far as the input."),
    ("frames.png", "Attention, cropped to the object", "The clearest moment of every winner. The boxes mark what is "
     "shown larger. The numbers compare the brightest pixel of the object with the brightest one elsewhere; the object "
     "is what is at least 0.35 times as bright as the brightest pixel after attention."),
    ("weights.png", "What was learned", "Each column holds the weights from one neuron to all others. Neurons that "
     "own an object have large ones, and their column is the object's list of features."),
    ("weights_over_time.png", "How it was learned", "Weights that each owner sends to the others."),
    ("outputs.png", "Outputs of the neurons", "A lane a neuron, all to the same scale. Owners are bold. What an owner "
     "inhibits fades as its weight grows."),
)  # fmt: skip
"""Files of a run, their titles and what to see in them."""


def write_run_page(result: RunResult, folder: Path, chosen: str) -> Path:
    """Write report.html about a run whose other files are in `folder`.

    Args:
        result: of the run.
        folder: where its files are, and where the page goes.
        chosen: the model's name, and why it was taken.
    """
    count = len(result.objects)
    found = [f"{count} object{'s' * (count != 1)} found." if count else "No objects found."]
    found += [f"Object {number}: {words(thing).strip()}." for number, thing in numbered(result.objects)]
    if result.table is not None:
        untaught = result.verdict == "learning" and not result.objects
        found.append(f"Verdict: {NOTHING_LEARNED if untaught else VERDICTS[result.verdict]}.")
    if result.interrupted:
        found.append("The run was stopped early; this is what was found so far.")
    facts = {
        "source": result.source,
        "frames": f"{result.frames} of {result.size[1]} x {result.size[0]} pixels, {result.simulated_seconds:g} s",
        "model": chosen,
        "time taken": f"{result.wall_seconds:.1f} s",
        **versions(),
    }
    tables = [features_table(result.objects)] if count else []
    shown = [Shown(folder / name, title, caption) for name, title, caption in SHOWN]
    return Page(f"{result.source}: what moves together", found, command_line(), facts, tables, shown).write(folder)


def features_table(things: list[BoundObject]) -> Table:
    """A row an object, a column a feature."""
    heads = ["object", "neuron", *FEATURES]
    rows = []
    for number, thing in numbered(things):
        cells = [f"{thing.features[name]:.2f}" if name in thing.features else "" for name in FEATURES]
        rows.append([str(number), thing.neuron, *cells])
    return Table("Features of every object", heads, rows, "Shares of the strongest; an empty cell: none of it.")
