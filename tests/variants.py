"""The suite as on other machines: `python tests/variants.py [NAME] [ARGUMENTS FOR PYTEST]`.

Names joined by `+` hold together: `no-vectors+random-order` is the suite in an order of chance on a processor without
vector instructions. CI runs one of `TURNS` in place of the plain suite, another with every commit: `--turn` picks it by
the number of commits.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLAIN = ("-n", "2", "--dist", "worksteal", "-q", "--durations", "10", "-m", "not bench and not realtime and not long")
"""What `make test` runs first."""

VARIANTS = {
    "plain": "as `make test` does",
    "random-order": "the tests in an order of chance; the seed is that of the commit's number and is printed",
    "no-vectors": "ATEN_CPU_CAPABILITY=default: a processor without vector instructions",
    "avx2": "ATEN_CPU_CAPABILITY=avx2: a processor without AVX-512",
    "old-blas": "OPENBLAS_CORETYPE=Prescott: NumPy as on a processor with SSE3 alone",
    "no-interrupt": "SIGINT ignored, as for a program in the background",
    "busy": "beside two processes that compute all the time",
    "no-home": "as a user who cannot write to HOME",
}
"""Name and what it is like."""

TURNS = ("plain", "no-vectors+old-blas+random-order+no-interrupt", "avx2+random-order+no-home", "busy+no-interrupt")
"""What CI runs by turns: together they hold every variant. `make test-variants` runs each alone."""

SET = {
    "no-vectors": {"ATEN_CPU_CAPABILITY": "default"},
    "avx2": {"ATEN_CPU_CAPABILITY": "avx2"},
    "old-blas": {"OPENBLAS_CORETYPE": "Prescott"},
}
"""The variables that a variant sets."""


def parts(joined: str) -> list[str]:
    """The variants of a joined name.

    Raises:
        ValueError: there is no such variant, or two of them set one variable.
    """
    names = joined.split("+")
    for name in names:
        if name not in VARIANTS:
            raise ValueError(f"no variant {name!r}; there are {', '.join(VARIANTS)}, and names joined by +")
    taken = [key for name in dict.fromkeys(names) for key in SET.get(name, {})]
    if len(taken) > len(set(taken)):
        raise ValueError(f"{joined}: two of these set {max(taken, key=taken.count)}")
    return names


def environment(names: Sequence[str], home: Path, folder: Path) -> dict[str, str]:
    """The variables that differ, where `folder` is one of the run's own."""
    changed = {key: value for name in names for key, value in SET.get(name, {}).items()}
    if "ATEN_CPU_CAPABILITY" in changed:
        # Another machine would not find what this one has compiled: with it, compiled sums were seen to be wrong.
        changed["TORCHINDUCTOR_CACHE_DIR"] = str(folder / "compiled")
    return changed | ({"HOME": str(home)} if "no-home" in names else {})


def options(names: Sequence[str], seed: int) -> list[str]:
    """What pytest is told besides."""
    return ["-p", "tests.shuffle", "--shuffle", str(seed)] if "random-order" in names else []


def run(joined: str, arguments: Sequence[str]) -> int:
    """Run the suite under one variant, or several joined; gives pytest's exit code."""
    seed, names = commits(), parts(joined)
    print(f"variant {joined}: {'; '.join(VARIANTS[name] for name in names)}", *options(names, seed), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder) / "home"
        home.mkdir(mode=0o500)
        if "no-home" in names and os.access(home, os.W_OK):
            # Root may write anywhere, but not below a file.
            home = Path(folder) / "file" / "home"
            home.parent.write_text("")
        changed = environment(names, home, Path(folder))
        command = [sys.executable, "-m", "pytest", *options(names, seed), *(arguments or PLAIN)]
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * ("busy" in names))]
        before = signal.signal(signal.SIGINT, signal.SIG_IGN) if "no-interrupt" in names else None
        try:
            # Bytecode that is kept spares every process half a minute of reading tests, and those they start a second.
            kept = {"PYTHONDONTWRITEBYTECODE": ""}
            return subprocess.run(command, cwd=ROOT, env=os.environ | kept | changed, check=False).returncode
        finally:
            if before is not None:
                signal.signal(signal.SIGINT, before)
            for process in busy:
                process.kill()
                process.wait()


def commits() -> int:
    """The number of commits up to here; 0 outside of a repository."""
    command = ["git", "rev-list", "--count", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return int(done.stdout) if done.returncode == 0 else 0


def main(arguments: Sequence[str]) -> int:
    names, rest = list(VARIANTS), list(arguments)
    if rest[:1] == ["--turn"]:
        names, rest = [TURNS[commits() % len(TURNS)]], rest[1:]
    elif rest and not rest[0].startswith("-") and not Path(ROOT, rest[0].split("::")[0]).exists():
        names = [rest.pop(0)]
    try:
        for name in names:
            parts(name)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    codes = {name: run(name, rest) for name in names}
    failed = [name for name, code in codes.items() if code != 0]
    if failed:
        print(f"failed under {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
