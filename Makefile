# `make` lists the targets. Needed: make, and Python 3.11 or newer with its venv module.
#
# One environment, in $(VENV), holds either the wheel (demo: what a user installs, with the URDFs inside) or the
# checkout in editable mode (test, lint, ...). Each installation removes the stamps of the other, so that changing
# sides costs seconds and calling the same target again costs nothing.

PYTHON ?= python3
VENV ?= .venv
PYTEST_ARGS ?=

BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --constraint constraints.txt
SOURCES := $(shell find framework robots urdf -type f ! -name '*.pyc' 2>/dev/null)
METADATA := pyproject.toml constraints.txt
NOTEBOOKS := $(wildcard notebooks/*.ipynb)
DEMO := crossing_C
# the modules of the API reference: the public face, and the submodules that a user calls by name
API := framework.public framework.errors framework.motion.law framework.motion.path framework.model.beams \
  framework.simulation framework.control framework.atlas.workspace_map framework.atlas.nearest \
  framework.dynamics.stiffness framework.dynamics.loading framework.dynamics.forward_dynamics framework.kinematics.pose_stack framework.show.plots \
  framework.show.maps robots

.PHONY: help demo test slow witness test-browser bench lint format docs notebooks clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: $(VENV)/.wheel  ## install, then plan the crossing of the paper's 5R robot with flexible links
	$(BIN)/crossing plan five_bar --scene C --flexibility flexible_links --out $(DEMO)
	@echo "The plan, the motion and the figures are in $(CURDIR)/$(DEMO):" && ls $(DEMO)

test: $(VENV)/.test  ## run the tests
	$(BIN)/python -m pytest --numprocesses auto $(PYTEST_ARGS)

slow: $(VENV)/.test  ## run the tests marked slow
	$(BIN)/python -m pytest -m slow --numprocesses auto $(PYTEST_ARGS) || [ $$? -eq 5 ]  # 5: there are none

witness: $(VENV)/.witness  ## hold our torques against MuJoCo and Exudyn, and maps through a dask cluster against this process
	CROSSING_WITNESS=required $(BIN)/python -m pytest tests/witness $(PYTEST_ARGS)

test-browser: $(VENV)/.browser  ## run the tests in a headless Chromium (Debian: apt-get install chromium)
	$(BIN)/python -m pytest -m browser tests/browser $(PYTEST_ARGS)

bench: $(VENV)/.test  ## print the benchmarks
	$(BIN)/python -m pytest -m benchmark -s $(PYTEST_ARGS) || [ $$? -eq 5 ]

lint: $(VENV)/.dev  ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.dev  ## mend style, as far as it can be mended by itself
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(VENV)/.dev  ## write the API reference from the docstrings to build/docs
	$(BIN)/python -W error -W 'ignore:Error parsing type annotation' -m pdoc $(API) --docformat google --math --output-directory build/docs

ifeq ($(NOTEBOOKS),)
notebooks:  ## execute the notebooks
	@echo "There are no notebooks yet."
else
notebooks: $(VENV)/.dev
	$(BIN)/jupyter execute --timeout=600 $(NOTEBOOKS)
endif

clean:  ## remove the environment, the caches and the output of the demo
	rm -rf $(VENV) $(DEMO) raw_B study crossing.html build dist .mypy_cache .pytest_cache .ruff_cache
	find framework robots tests -type d -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.wheel: $(VENV)/.created $(METADATA) $(SOURCES)
	@rm -f $(VENV)/.test $(VENV)/.dev $(VENV)/.witness $(VENV)/.browser
	$(INSTALL) .
	@touch $@

$(VENV)/.test: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[test]'
	@touch $@

$(VENV)/.dev: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[dev]'
	@touch $(VENV)/.test $@

$(VENV)/.witness: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[test,witness,dask]'
	@touch $(VENV)/.test $@

$(VENV)/.browser: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[browser]'
	@touch $(VENV)/.test $@
