# The commands of this project. `make demo` and `make test` need Python 3.11+, its venv module and
# make, nothing else: they set up .venv from the lock files when these have changed.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
JOBS   ?= 2
# Python compiles a module when it is first imported, unless the environment forbids it to keep that;
# to compile all is a third of an installation
LATER   := $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile)
INSTALL := $(BIN)/python -m pip --disable-pip-version-check --quiet install $(LATER) --no-deps

.PHONY: help demo test long quick coverage lint types layers unit unit-quick bench soak oldest pictures reference docs docs-serve lock clean
.DEFAULT_GOAL := help

help:           ## list the targets
	@sed -n 's/^\([a-z-]*\):[^#]*##/\1:/p' $(MAKEFILE_LIST) | column -t -s: 2>/dev/null

$(VENV)/demo.stamp: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "motord needs Python 3.11 or newer; try make PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "setting up $(VENV) (once; a minute or two)"
	@$(INSTALL) --require-hashes -r requirements.lock
	@$(INSTALL) --no-build-isolation -e .
	@echo "compiling the kernels (once)"
	@out=$$(mktemp -d) && $(BIN)/motord demo --quick --json --out $$out >/dev/null && rm -rf $$out
	@touch $@

$(VENV)/dev.stamp: requirements-dev.lock $(VENV)/demo.stamp
	@echo "setting up the development tools (once)"
	@$(INSTALL) --require-hashes -r requirements-dev.lock
	@touch $@

demo: $(VENV)/demo.stamp  ## calibrate the simulated rig and show the ripple before and after
	@$(BIN)/motord demo

test: lint                ## every check but `long`: lint, types, layers, tests
	@$(MAKE) --no-print-directory --jobs 3 types layers unit

long: $(VENV)/dev.stamp   ## the tests that take minutes each: the bring-up guide, whole plans, the emulated machine
	@$(BIN)/python -m tests.vm.kernel
	@$(BIN)/python tests/run.py --long --jobs $(JOBS)

quick: $(VENV)/dev.stamp  ## for daily work: lint, types, layers and the unit tests that matter, under a minute
	@$(MAKE) --no-print-directory --jobs $(JOBS) --output-sync=target lint types layers unit-quick

lint: $(VENV)/dev.stamp   ## ruff
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(VENV)/dev.stamp  ## mypy --strict
	@nice -n 5 $(BIN)/mypy

layers: $(VENV)/dev.stamp ## import-linter
	@nice -n 5 $(BIN)/lint-imports

unit: $(VENV)/dev.stamp   ## tests
	@$(BIN)/python tests/run.py --jobs $(JOBS)

coverage: $(VENV)/dev.stamp ## the lines that the tests without processes reach: at least 90 %
	@$(BIN)/python tests/run.py --jobs $(JOBS) --coverage

unit-quick: $(VENV)/dev.stamp
	@$(BIN)/python tests/run.py --quick --jobs $(JOBS)

pictures: $(VENV)/dev.stamp ## draw the pictures of README and docs anew
	@out=$$(mktemp -d) && $(BIN)/motord demo --json --out $$out >/dev/null && \
	    $(BIN)/python tools/pictures.py $$out && \
	    $(BIN)/python tools/ripple_picture.py $$out && rm -rf $$out
	@out=$$(mktemp -d) && $(BIN)/motord simulate torque-speed -c config/efficiency.toml -o $$out/map.mcap && \
	    $(BIN)/python tools/efficiency_picture.py $$out/map.mcap && rm -rf $$out
	@out=$$(mktemp -d) && $(BIN)/motord simulate thermal -c config/thermal.toml -o $$out/heat.mcap && \
	    $(BIN)/python tools/thermal_picture.py $$out/heat.mcap && rm -rf $$out
	@out=$$(mktemp -d) && $(BIN)/python tools/soak_picture.py $$out/soak.mcap && rm -rf $$out
	@$(BIN)/python tools/wiring.py
	@$(BIN)/python tools/architecture.py
	@$(BIN)/python tools/watch_pictures.py
	@$(BIN)/python tools/notebook.py
	@$(BIN)/python tools/screenshots.py

reference: $(VENV)/dev.stamp ## write docs/reference anew, from the code
	@$(BIN)/python -m tools.reference

docs: reference           ## build the documentation into site/; a warning is an error
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet && echo "site/index.html"

docs-serve: reference     ## show the documentation on port 8000, built anew when a page changes
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs serve --quiet

bench: $(VENV)/dev.stamp  ## measure; prints a table, writes bench.json
	@$(BIN)/python -m tests.benchmarks.run --json bench.json

ifndef SEED
SEED := $(shell od -An -N2 -tu2 /dev/urandom | tr -d ' ')
endif
CAMPAIGNS ?= properties estimator quick coverage check_calibration tracking departures dc_departures cogging cogging_speeds jerky ripple back_emf driven_departures inertia friction sensitivity learn learn_orders align torque_speed thermal stuck_tracks interlock_search soak mutation:--few \
	mutation faults faults:--random=200 faults:--wire fuzz hostile flood plan_kills memory rerun_loader
soak: $(VENV)/dev.stamp   ## the long campaigns with random seeds; CAMPAIGNS="learn faults" for some, SEED=n for a seed again
	@red=; for one in $(CAMPAIGNS); do name=$${one%%:*}; option=$${one#$$name}; echo "== $$one SEED=$(SEED)"; \
	    SEED=$(SEED) $(BIN)/python -m tests.campaigns.$$name $$(echo "$${option#:}" | tr = ' ') || red="$$red $$one"; done; \
	    test -z "$$red" || { echo "again: make soak CAMPAIGNS='$${red# }' SEED=$(SEED)"; exit 1; }

oldest:                   ## the unit tests with the oldest versions that pyproject.toml allows
	@tools/oldest

lock:                     ## pin the newest versions that fit pyproject.toml
	@tools/lock

clean:                    ## remove what the targets made
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis .coverage* htmlcov site
