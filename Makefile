# make demo    one factory mission with a recording; installs what it needs into .venv
# make test    lint, format, types, layers and the fast tests; installs what it needs into .venv
# make help    all targets

VENV ?= .venv
BIN := $(VENV)/bin
# Ray is installed apart: it is large, and only `vuca train --collector ray` and `vuca eval --backend ray` need it.
RAY_VENV ?= .venv-ray
# So is stable-baselines3: nothing here needs it but its adapter. moviepy writes the video that a test records, and wants
# an older Pillow than the lock has.
SB3_VENV ?= .venv-sb3
AUDIT_VENV ?= .venv-audit
comma := ,
RUNS ?= runs
ROBOT ?= tiago
METHOD ?= ours-dh
WORKERS ?= 2
# A mission in which both bodies arrive; many with moving obstacles do not yet (docs/results/index.md).
DEMO_REGION ?= 1
DEMO_SEED ?= 8

# The first Python that will do; override with `make PYTHON=/path/to/python3.12 ...`.
FITS := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c '$(FITS)' 2>/dev/null && command -v $$p && break; done)

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow test-ray test-sb3 lint format types layers audit bench docs lock clean

help: ## this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

# -- installation: one lock file, used as constraints, so the demo does without the developer's tools ----------

%/bin/python:
	@test -n "$(PYTHON)" || { echo "make: needs Python 3.11, 3.12 or 3.13 on PATH, or make PYTHON=/path/to/python3.12" >&2; exit 1; }
	@$(PYTHON) -c '$(FITS)' || { echo "make: needs Python 3.11, 3.12 or 3.13, which it is tried with, not $$($(PYTHON) --version 2>&1)" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "make: $(PYTHON) has no venv module; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $*

# $(call install,VENV,EXTRAS). dm-control comes by itself, without labmaze, which Python 3.13 cannot install (pyproject.toml).
PIP_INSTALL := -m pip install --quiet --disable-pip-version-check -c requirements.lock
define install
	$(1)/bin/python $(PIP_INSTALL) -e '.[$(2)]'
	$(1)/bin/python $(PIP_INSTALL) --no-deps dm-control
endef

$(VENV)/.installed-sim: requirements.lock pyproject.toml | $(BIN)/python
	$(call install,$(VENV),sim)
	@touch $@

$(VENV)/.installed-dev: requirements.lock pyproject.toml | $(BIN)/python
	$(call install,$(VENV),dev)
	@touch $@ $(VENV)/.installed-sim

$(VENV)/.installed-docs: requirements.lock pyproject.toml | $(BIN)/python
	$(BIN)/python $(PIP_INSTALL) -e '.[docs]'
	@touch $@

$(RAY_VENV)/.installed: requirements.lock pyproject.toml | $(RAY_VENV)/bin/python
	$(call install,$(RAY_VENV),dev$(comma)distributed)
	@touch $@

$(SB3_VENV)/.installed: requirements.lock pyproject.toml | $(SB3_VENV)/bin/python
	$(call install,$(SB3_VENV),dev$(comma)sb3)
	$(SB3_VENV)/bin/python -m pip install --quiet --disable-pip-version-check moviepy
	@touch $@

lock: ## pin the newest versions that fit pyproject.toml, resolved in a clean environment
	@test -n "$(PYTHON)" || { echo "make: needs Python 3.11, 3.12 or 3.13 on PATH" >&2; exit 1; }
	@set -e; tmp=$$(mktemp -d); trap 'rm -rf "$$tmp"' EXIT; \
	$(PYTHON) -m venv "$$tmp/venv"; \
	"$$tmp/venv/bin/python" -m pip install --quiet --disable-pip-version-check -e '.[dev,docs,distributed]'; \
	"$$tmp/venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps dm-control==1.0.50; \
	{ echo '# Exact versions of everything in vuca-nav[dev,docs,distributed] (which include [sim], [train], [deploy] and [zenoh]); made by `make lock`.'; \
	  "$$tmp/venv/bin/python" -m pip freeze --exclude-editable | grep -v '^#' | sed 's/+cpu$$//' | grep -v '^nvidia\|^triton\|^cuda' | LC_ALL=C sort -f; } > "$$tmp/lock"; \
	cp "$$tmp/lock" requirements.lock; echo "requirements.lock: $$(grep -c == requirements.lock) packages"

# -- what a user wants ------------------------------------------------------------------------------------------

demo: $(VENV)/.installed-sim ## one factory mission, recorded; ROBOT=go2 walks, METHOD=dwa-dh plans by a dynamic window
	@mkdir -p $(RUNS)
	@echo "$(ROBOT) in factory region $(DEMO_REGION), ten moving obstacles a quarter. The first run compiles the kernels: about a minute,"
	@echo "which counts in its real-time factor."
	$(BIN)/vuca run --world factory --region $(DEMO_REGION) --robot $(ROBOT) --method $(METHOD) --seed $(DEMO_SEED) --record $(RUNS)/demo.rrd
	@echo "The recording is $(RUNS)/demo.rrd. Open it with: $(BIN)/rerun $(RUNS)/demo.rrd"

bench: $(VENV)/.installed-sim ## ratios against named references
	$(BIN)/vuca bench

# -- what a developer wants -------------------------------------------------------------------------------------

test: lint types layers ## everything CI checks
	$(BIN)/pytest -n $(WORKERS)

test-slow: $(VENV)/.installed-dev ## the tests that take minutes
	$(BIN)/pytest -n $(WORKERS) -m slow -rs

test-ray: $(RAY_VENV)/.installed ## training and evaluation on a local Ray, two workers, in an environment of its own, .venv-ray
	$(RAY_VENV)/bin/pytest -m 'slow or not slow' tests/train/navigation/test_ray.py tests/eval/test_ray_runner.py

test-sb3: $(SB3_VENV)/.installed ## stable-baselines3 trains in both environments, five minutes, in an environment of its own, .venv-sb3
	$(SB3_VENV)/bin/pytest -m 'slow or not slow' -rs tests/train/arena/test_sb3_env.py tests/robots/test_scene_camera.py

lint: $(VENV)/.installed-dev ## style and format, nothing is changed
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(VENV)/.installed-dev ## static types
	$(BIN)/pyright --pythonpath $(BIN)/python

layers: $(VENV)/.installed-dev ## one direction of imports
	$(BIN)/lint-imports

audit: | $(AUDIT_VENV)/bin/python ## known weaknesses of the locked packages; skipped where no database is reached
	$(AUDIT_VENV)/bin/python .ci/audit.py

docs: $(VENV)/.installed-docs ## the pages as a site, build/site/index.html; a broken link ends it
	$(BIN)/mkdocs build --strict

format: $(VENV)/.installed-dev ## put the code into the project's style
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean: ## caches; not .venv, not runs/
	rm -rf build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache *.egg-info
	find eval robots tests train vuca_nav worlds -name __pycache__ -type d -prune -exec rm -rf {} +
