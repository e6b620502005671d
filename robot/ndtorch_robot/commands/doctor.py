"""`ndtorch doctor`."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass

MARKS = {"works": "ok  ", "missing": "-   ", "fails": "FAIL"}


@dataclass(frozen=True)
class Doctor:
    """Say what is installed, what of this machine is used, what does not work, and what to do about it.

    Exit code 1 if something fails that is needed; cameras, OpenGL and boards that are not there do not count.
    """

    prepare: bool = False
    """All kernels are compiled now, so that no first start waits for them: for images of small computers."""
    json: bool = False
    """The findings are printed as one JSON object."""

    def run(self) -> int:
        from ndtorch_robot.doctor import examine

        found = []
        for finding in examine():
            found.append(finding)
            if not self.json:
                advice = f"\n{'':29s} -> {finding.advice}" if finding.advice else ""
                print(f"{MARKS[finding.state]} {finding.part:24s} {finding.words}{advice}", flush=True)
        seconds = self.prepared() if self.prepare else {}
        failed = [finding.part for finding in found if finding.state == "fails"]
        if self.json:
            print(json.dumps({"findings": [f._asdict() for f in found], "prepared_s": seconds, "failed": failed}))
        elif failed:
            print(f"does not work: {', '.join(failed)}")
        return 1 if failed else 0

    def prepared(self) -> dict[str, float]:
        """Compile all kernels; seconds by name."""
        import torch

        from ndtorch_robot.doctor import preparations

        torch.set_num_threads(1)
        taken = {}
        for name, prepare in preparations():
            began = time.perf_counter()
            prepare()
            taken[name] = round(time.perf_counter() - began, 3)
            print(f"{taken[name]:8.1f} s  {name}", file=sys.stderr if self.json else sys.stdout, flush=True)
        return taken
