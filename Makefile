# `make` lists the targets. Needed: make, and Python 3.11 or newer with its venv module.
#
# One environment, in $(VENV), holds either the wheel (demo: what a user installs, with the URDFs inside) or the
# checkout in editable mode (test, lint, ...). Each installation removes the stamps of the other, so that changing
# sides costs seconds and calling the same target again costs nothing.

PYTHON ?= python3
VENV ?= .venv
PYTEST_ARGS ?=
CHART_ARGS ?=
SEED ?= 1
COUNT ?= 40
PACKAGES ?=

BIN := $(VENV)/bin
# One process a core, each with a stretch of the tests, which share what is computed once; who is done takes from the
# other. And one thread a process: threads of processes that share a core wait for one another.
ON_ALL_CORES := --numprocesses auto --dist worksteal
export OPENBLAS_NUM_THREADS ?= 1
# Tests start hundreds of Pythons: what one has compiled the others read.
unexport PYTHONDONTWRITEBYTECODE
INSTALL := $(BIN)/python -m pip install --disable-pip-version-check --constraint constraints.txt
SOURCES := $(shell find framework robots urdf -type f ! -name '*.pyc' 2>/dev/null)
METADATA := pyproject.toml constraints.txt
NOTEBOOKS := $(wildcard notebooks/*.ipynb)
DEMO := crossing_C
# what meets every package that the framework calls, in less than half a minute; and what meets the interpreter
PROCESSES := tests/numerics/test_interruption.py tests/numerics/test_workers.py
SOME_TESTS := $(filter-out $(PROCESSES), $(wildcard tests/numerics/test_*.py)) tests/laws \
  tests/singularity/test_traced_locus.py tests/robots/test_every_robot.py tests/show/test_plots.py \
  tests/planning/test_durations.py tests/test_cli_pose.py tests/test_cli_simulate.py

.PHONY: help demo test lowest pythons slow mutants witness test-browser bench chart lint format docs release-check notebooks clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: $(VENV)/.wheel  ## install, then plan the crossing of the paper's 5R robot with flexible links
	$(BIN)/crossing plan five_bar --scene C --flexibility flexible_links --out $(DEMO)
	@echo "The plan, the motion and the figures are in $(CURDIR)/$(DEMO):" && ls $(DEMO)

test: $(VENV)/.test  ## run the tests
	$(BIN)/python -m pytest $(ON_ALL_CORES) $(PYTEST_ARGS)

lowest: $(VENV)-lowest/.test  ## run some tests with the lowest version that pyproject.toml allows of each package
	$(VENV)-lowest/bin/python -m pytest $(ON_ALL_CORES) -W default::DeprecationWarning $(SOME_TESTS) $(PYTEST_ARGS)

pythons:  ## run some tests on Python 3.12 and 3.13, where they are here and pin has a wheel for them
	.ci/try_python python3.12 $(VENV)-python3.12 $(ON_ALL_CORES) $(SOME_TESTS) $(PROCESSES) $(PYTEST_ARGS)
	.ci/try_python python3.13 $(VENV)-python3.13 $(ON_ALL_CORES) $(SOME_TESTS) $(PROCESSES) $(PYTEST_ARGS)

slow: $(VENV)/.test  ## run the tests marked slow
	$(BIN)/python -m pytest -m slow $(ON_ALL_CORES) $(PYTEST_ARGS) || [ $$? -eq 5 ]  # 5: there are none

mutants: $(VENV)/.test  ## print random changes of the code that no test notices: SEED=7 COUNT=40 PACKAGES="laws proofs"
	$(BIN)/python -m tests.mutants --seed $(SEED) --count $(COUNT) $(if $(PACKAGES),--packages $(PACKAGES))

witness: $(VENV)/.witness  ## hold our torques against MuJoCo and Exudyn, and maps through a dask cluster against this process
	CROSSING_WITNESS=required $(BIN)/python -m pytest $(ON_ALL_CORES) -m 'not benchmark and not browser' tests/witness $(PYTEST_ARGS)

test-browser: $(VENV)/.browser  ## run the tests in a headless Chromium (Debian: apt-get install chromium)
	$(BIN)/python -m pytest -m browser tests/browser $(PYTEST_ARGS)

bench: $(VENV)/.test  ## print the benchmarks
	$(BIN)/python -m pytest -m benchmark -s $(PYTEST_ARGS) || [ $$? -eq 5 ]

chart: $(VENV)/.witness  ## speed against accuracy of all methods: figures and tables in chart/
	$(BIN)/python -m tests.benchmarks.chart $(CHART_ARGS)

lint: $(VENV)/.dev  ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.dev  ## mend style, as far as it can be mended by itself
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/python .ci/wrap_changelog

docs: $(VENV)/.docs  ## build the site to build/docs/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

release-check:  ## build wheel and sdist, check them, and run the demo from the wheel in an empty environment
	.ci/release_check

notebooks: $(VENV)/.notebooks  ## execute the notebooks, and compare what they print with what is stored
	printf '%s\n' $(NOTEBOOKS) | xargs -n 1 -P 2 $(BIN)/python -m tests.notebook_outputs

clean:  ## remove the environment, the caches and the output of the demo
	rm -rf $(VENV) $(VENV)-lowest $(VENV)-python3.* $(DEMO) raw_B study chart crossing.html build dist .mypy_cache .pytest_cache .ruff_cache
	find framework robots tests -type d -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.wheel: $(VENV)/.created $(METADATA) $(SOURCES)
	@rm -f $(VENV)/.test $(VENV)/.dev $(VENV)/.docs $(VENV)/.notebooks $(VENV)/.witness $(VENV)/.browser
	@echo "Installing into $(VENV). The first time pip fetches some 50 packages, 175 MB (pinocchio, scipy, matplotlib and"
	@echo "what they need), without a word: a minute or two. Afterwards this takes seconds."
	$(INSTALL) --quiet .
	@touch $@

$(VENV)/.test: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[test]'
	@touch $@

$(VENV)-lowest/.test: $(METADATA) .ci/lowest_versions
	$(PYTHON) -m venv $(@D)
	$(PYTHON) .ci/lowest_versions > $(@D)/constraints.txt
	$(@D)/bin/python -m pip install --no-compile --disable-pip-version-check --constraint $(@D)/constraints.txt --editable '.[test]'
	@touch $@

$(VENV)/.dev: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[dev]'
	@touch $(VENV)/.test $@

$(VENV)/.docs: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[docs]'
	@touch $@

# crocoddyl without its dependencies: of these only pinocchio is used, and it asks for an older one.
$(VENV)/.notebooks: $(VENV)/.dev
	$(INSTALL) --no-deps crocoddyl libcrocoddyl
	@touch $@

$(VENV)/.witness: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[test,witness,dask]'
	@touch $(VENV)/.test $@

$(VENV)/.browser: $(VENV)/.created $(METADATA)
	@rm -f $(VENV)/.wheel
	$(INSTALL) --editable '.[browser]'
	@touch $(VENV)/.test $@
