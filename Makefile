# make demo   install into .venv, find the objects in the two-bars scene, then drive through the simulated hallway
# make test   install and run every test that needs no special hardware
# make test-unit  the quick ones alone: no whole runs, no C++ compiler
# make test-long  the strong forms of some tests, minutes each
# make check  lint, format and types     make bench  timings side by side, out/bench.json
# make bench-compare OLD=... NEW=...  fails where a row takes over 15 % more of a reference job
# make docs    the documentation site, out/docs/index.html, its examples executed, its links followed
# make docs-quick  the same in half a minute, out/docs-quick: its examples are not executed
# make wheels  each distribution alone in an empty environment
# make soak    half an hour of simulated driving with injected faults; MINUTES=600 for a night, and it continues where it was
# make lock    uv.lock anew      make sbom   what is installed, out/sbom.json      make audit  known vulnerabilities of what is locked
# make reproduce        every published claim again      make reproduce-quick  the same in under two minutes
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
# One thread: two threads get in each other's way as soon as another process wants the second core.
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

.PHONY: setup demo test test-unit test-long check docs docs-quick wheels bench bench-compare soak lock sbom audit reproduce reproduce-quick clean

setup: $(STAMP)

$(STAMP): pyproject.toml robot/pyproject.toml train/pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "ndtorch needs Python 3.11 or newer; set PYTHON=...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) 'pip>=25.1'
	$(PIP) --group dev -e '.[view]' -e 'robot[sim,view]' -e train
	touch $@

demo: $(STAMP)
	$(BIN)/ndtorch bind two-bars --out out
	$(BIN)/ndtorch drive --out out/drive

PYTEST := $(BIN)/python -m pytest -q

test: $(STAMP)
	$(PYTEST) -n 2 --dist worksteal --durations 10 -m 'not bench and not long and not realtime'
	$(PYTEST) -p no:randomly -m 'realtime and not long'

test-unit: $(STAMP)
	$(PYTEST) -n 2 --dist worksteal -m 'not slow and not compiled and not long and not realtime and not bench'

test-long: $(STAMP)
	$(PYTEST) -n 2 --dist worksteal --durations 10 -m 'long and not realtime'
	$(PYTEST) -p no:randomly -m 'long and realtime'

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict ndtorch robot/ndtorch_robot train/ndtorch_train
	$(BIN)/mypy --config-file= $(addprefix --disable-error-code=,$(LOOSE)) docs/examples

# Examples are scripts without annotations: what is checked is that names and arguments exist.
LOOSE := arg-type assignment attr-defined misc operator var-annotated

DOCS := $(VENV)/.docs

$(DOCS): $(STAMP)
	$(PIP) --group docs
	touch $@

docs: $(DOCS)
	$(BIN)/sphinx-build -q -W --keep-going -b html docs out/docs
	$(BIN)/python docs/check_links.py out/docs

docs-quick: $(DOCS)
	$(BIN)/sphinx-build -q -W --keep-going -D plot_gallery=0 -b html docs out/docs-quick
	$(BIN)/python docs/check_links.py out/docs-quick

# Takes minutes and a gigabyte an environment: every wheel gets only what it asks for.
wheels: $(STAMP)
	$(BIN)/python tests/wheels.py

bench: $(STAMP)
	$(BIN)/python -m tests.benchmarks --json out/bench.json

# make bench-compare OLD=before.json NEW=out/bench.json
bench-compare: $(STAMP)
	$(BIN)/python -m tests.benchmarks.compare $(OLD) $(NEW)

MINUTES ?= 30
soak: $(STAMP)
	$(BIN)/python -m tests.fault_injection --minutes $(MINUTES)

# Tools that look at packages have an environment of their own: what they need is not what is looked at.
SUPPLY := .venv/supply

$(SUPPLY)/bin/uv: constraints.txt | $(STAMP)
	test -x $(SUPPLY)/bin/python || $(BIN)/python -m venv $(SUPPLY)
	$(SUPPLY)/bin/python -m pip install --quiet --disable-pip-version-check uv==$(call pinned,uv) \
		cyclonedx-bom==$(call pinned,cyclonedx-bom) pip-audit==$(call pinned,pip-audit)
	touch $@

pinned = $(shell sed -n 's/^$(1)==//p' constraints.txt)

lock: $(SUPPLY)/bin/uv
	$(SUPPLY)/bin/uv lock

# Where on this disk the distributions of this project lie is nobody's business.
sbom: $(SUPPLY)/bin/uv
	mkdir -p out
	$(SUPPLY)/bin/cyclonedx-py environment $(BIN)/python --pyproject pyproject.toml --output-format JSON \
		--output-reproducible --output-file out/sbom.part
	sed 's|"file://[^"]*/\([^"/]*\)"|"file:\1"|' out/sbom.part > out/sbom.json
	rm out/sbom.part

audit: $(SUPPLY)/bin/uv
	mkdir -p out
	$(SUPPLY)/bin/uv export -q --frozen --all-packages --all-extras --all-groups --no-emit-workspace -o out/locked.txt
	$(SUPPLY)/bin/pip-audit --require-hashes --disable-pip -r out/locked.txt

reproduce: $(STAMP)
	$(BIN)/ndtorch reproduce

reproduce-quick: $(STAMP)
	$(BIN)/ndtorch reproduce --quick --out out/reproduce-quick

clean:
	rm -rf $(VENV) out .mypy_cache .pytest_cache .ruff_cache
