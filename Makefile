# Set-up and checks. README.md says what to type on a machine without make.
#
#   make demo    the whole chain against a simulated cell, from nothing
#   make test    the test suite, on all processors
#   make quick   what of it takes less than a minute
#   make long    tests that take many seconds each: runs killed at every record, faults, odd files
#   make test-lowest   the test suite with the lowest versions that pyproject.toml allows
#   make test-pythons  the test suite with every Python from 3.11 on that is installed
#   make peers   tests with real peers: a controller, other people's clients, a browser
#   make lint    style, format, types and layers
#   make bench   how long users wait, real robots, and how large the house is
#   make pictures  the pictures of docs/, drawn anew; needs chromium
#   make reference  docs/reference/commands.md and the tables of keys, from the code
#   make torture the tests by garbage, kills, signals and faults with larger numbers; takes hours;
#                SEEDS=1000 is how many stories of faults are drawn
#
# PYTHON names the interpreter that the environment is made with (3.11 or newer), VENV where it
# lies: make test PYTHON=python3.12

PYTHON ?= python3
VENV ?= .venv
SEEDS ?= 1000
BIN := $(VENV)/bin
DEMO := demo/$(shell date +%Y-%m-%d-%H%M%S)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Every process of the tests would compile all anew.
unexport PYTHONDONTWRITEBYTECODE

# pip does it of what it copies; without it, where Python may not write it, each command would.
COMPILE := $(BIN)/python -m compileall -q app campaigns drivers sim pkmcal.py
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist worksteal

.PHONY: demo test quick long test-lowest test-pythons peers lint bench pictures reference torture
.DELETE_ON_ERROR:

demo: $(VENV)/installed
	@mkdir -p demo
	$(BIN)/pkmcal dry-run $(DEMO) --scenario realistic
	@echo "Open file://$(CURDIR)/$(DEMO)/report.html"

test: $(VENV)/installed-dev
	$(PYTEST) -m "not peer and not long"

quick: $(VENV)/installed-dev
	$(PYTEST) -m "not slow and not peer and not long"

long: $(VENV)/installed-dev
	$(PYTEST) -m "long and not peer"
	$(BIN)/python -m pytest -m "long and peer"

test-lowest: .venv-lowest/installed
	.venv-lowest/bin/python -m pytest --numprocesses auto --dist worksteal -m "not peer and not long"

# Each has an environment of its own; one that is not installed is passed over.
test-pythons:
	@failed=0; \
	for version in 3.11 3.12 3.13 3.14; do \
		python$$version --version >/dev/null 2>&1 || { echo "== python$$version: not installed"; continue; }; \
		echo "== python$$version"; \
		$(MAKE) test PYTHON=python$$version VENV=.venv-$$version || failed=1; \
	done; \
	exit $$failed

# One after the other: controllers and browsers need the processors for themselves.
peers: $(VENV)/installed-dev
	$(BIN)/python -m pytest -o cache_dir=.pytest_cache/peers -m "peer and not long"

lint: $(VENV)/installed-dev
	@failed=0; \
	for check in "ruff check" "ruff format --check" mypy lint-imports; do \
		echo "== $$check"; \
		$(BIN)/$$check || failed=1; \
	done; \
	exit $$failed

reference: $(VENV)/installed-dev
	$(BIN)/python docs/make_reference.py

pictures: $(VENV)/installed-dev
	$(BIN)/python docs/pictures/make_dry_run.py
	$(BIN)/python docs/pictures/make_gain.py
	$(BIN)/python docs/pictures/make_mechanisms.py
	$(BIN)/python docs/pictures/make_screens.py

bench: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks.timings
	$(BIN)/python -m benchmarks.real ur10
	$(BIN)/python -m benchmarks.real ur10-poses
	$(BIN)/python -m benchmarks.real printer
	$(BIN)/python -m benchmarks.real callipers
	$(BIN)/python -m benchmarks.size

# One after the other: what has to come in time needs the processors for itself.
torture: $(VENV)/installed-dev
	$(BIN)/python -m pytest -m torture --times 50 --seeds $(SEEDS)

# Whatever is installed is installed again when what it depends on has changed.
$(VENV)/installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	@$(COMPILE)
	@touch $@

$(VENV)/installed-dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	@$(COMPILE)
	@touch $@ $(VENV)/installed

.venv-lowest/installed: pyproject.toml .ci/lowest_versions.py
	$(PYTHON) -m venv .venv-lowest
	.venv-lowest/bin/python .ci/lowest_versions.py > .venv-lowest/lowest.txt
	.venv-lowest/bin/python -m pip install --quiet --constraint .venv-lowest/lowest.txt --editable ".[dev]"
	@touch $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(PYTHON) is missing or older than 3.11: name another one, make PYTHON=…" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
