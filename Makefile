# The commands of this project. `make demo` and `make test` need Python 3.11+, its venv module and
# make, nothing else: they set up .venv from the lock files when these have changed.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet
JOBS   ?= 2

.PHONY: help demo test lint types layers unit bench soak pictures lock clean
.DEFAULT_GOAL := help

help:           ## list the targets
	@sed -n 's/^\([a-z]*\):[^#]*##/\1:/p' $(MAKEFILE_LIST) | column -t -s: 2>/dev/null

$(VENV)/demo.stamp: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "motord needs Python 3.11 or newer; try make PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "setting up $(VENV) (once; a minute or two)"
	@$(PIP) install --require-hashes -r requirements.lock
	@$(PIP) install --no-build-isolation --no-deps -e .
	@echo "compiling the kernels (once)"
	@out=$$(mktemp -d) && $(BIN)/motord demo --quick --json --out $$out >/dev/null && rm -rf $$out
	@touch $@

$(VENV)/dev.stamp: requirements-dev.lock $(VENV)/demo.stamp
	@echo "setting up the development tools (once)"
	@$(PIP) install --require-hashes -r requirements-dev.lock
	@touch $@

demo: $(VENV)/demo.stamp  ## calibrate the simulated rig and show the ripple before and after
	@$(BIN)/motord demo

test: lint types layers unit  ## every check: lint, types, layers, tests with coverage

lint: $(VENV)/dev.stamp   ## ruff
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(VENV)/dev.stamp  ## mypy --strict
	@$(BIN)/mypy

layers: $(VENV)/dev.stamp ## import-linter
	@$(BIN)/lint-imports

unit: $(VENV)/dev.stamp   ## tests with coverage
	@$(BIN)/python tests/run.py --jobs $(JOBS)

pictures: $(VENV)/demo.stamp ## draw the pictures of the README anew
	@out=$$(mktemp -d) && $(BIN)/motord demo --json --out $$out >/dev/null && \
	    $(BIN)/python tools/pictures.py $$out && rm -rf $$out
	@$(BIN)/python tools/wiring.py

bench: $(VENV)/dev.stamp  ## measure; prints a table, writes bench.json
	@$(BIN)/python -m tests.benchmarks.run --json bench.json

CAMPAIGNS ?= estimator cogging back_emf inertia sensitivity learn align mutation faults \
	faults:--random=200 faults:--wire fuzz plan_kills memory
soak: $(VENV)/dev.stamp   ## the long campaigns, one after the other; CAMPAIGNS="learn faults" for some
	@for one in $(CAMPAIGNS); do name=$${one%%:*}; option=$${one#$$name}; echo "== $$one"; \
	    $(BIN)/python -m tests.campaigns.$$name $$(echo "$${option#:}" | tr = ' ') || exit 1; done

lock:                     ## pin the newest versions that fit pyproject.toml
	@tools/lock

clean:                    ## remove what the targets made
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis .coverage* htmlcov
