# Everything runs in .venv, which `make venv` fills with exactly what requirements/dev.txt locks.
# `make run` needs only its first part, what requirements/runtime.txt locks: half the time.

PYTHON ?= python3
ARGS ?=
VENV := .venv
BIN := $(VENV)/bin

# One thread per process: the processes are what runs in parallel, and sums keep their order.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests are compiled once, not in each process of each run: 9 s in each.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help venv test test-all lint format run paper bench soak docs docs-tables lock wheel clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

venv: $(VENV)/.locked ## Create .venv from the lock (PYTHON=python3.12 for another Python)

# Compiled on all cores, without the packages' own tests; pip would take one.
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --require-hashes -r $(1) && \
	{ $(BIN)/python -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib || true; }

$(VENV)/.runtime: requirements/runtime.txt requirements/dev.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "make: Python 3.11 or newer is needed, '$(PYTHON)' is: $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "make: name another one: make venv PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
	$(call INSTALL,requirements/runtime.txt)
	@touch $@

$(VENV)/.installed: pyproject.toml $(VENV)/.runtime
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	@touch $@

# pip takes one core: on another one a small design compiles the kernels that all processes load.
$(VENV)/.locked: $(VENV)/.installed
	$(BIN)/python -c "import expdesign; from tests.tiny_run import tiny_run; expdesign.design(tiny_run())" \
	  >/dev/null 2>&1 & $(call INSTALL,requirements/dev.txt); status=$$?; wait; exit $$status
	@touch $@

# `make test` keeps two cores busy; the other tests also wait for programs and clusters.
PYTEST := $(BIN)/python -m pytest --dist worksteal

test: venv ## Run the tests, 6 to 10 minutes on two cores (ARGS="-k jacobian" for some of them)
	@$(BIN)/python -m compileall -qq -j 0 constraints expdesign estimation results # once, not in each process
	$(PYTEST) -n 2 -m "not slow and not system" $(ARGS)

test-all: venv ## Run what `make test` leaves out: fuzz, kills, hostile input, large Monte Carlo, browser
	$(PYTEST) -n 3 -m "(slow or system) and not full" $(ARGS)

lint: venv ## Check style, types and architecture
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: venv ## Format the code and sort its imports
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

run: $(VENV)/.installed ## Design the example experiment: palida, into runs/palida
	$(BIN)/expdesign run palida $(ARGS)

paper: venv ## Repeat the paper's three studies: runs/paper/report.html (ROBOT=my.yaml for another)
	$(BIN)/python examples/paper/run.py $(if $(ROBOT),--robot $(ROBOT)) $(ARGS)

bench: venv ## Run the benchmarks
	$(BIN)/python benchmarks/run.py $(ARGS)

soak: venv ## Try to break it, for an hour (ARGS="inputs --seed 7" for a section)
	$(BIN)/python tests/soak/run.py $(ARGS)

# The site has an environment of its own: CI does without, the tests check the links.
SITE := build/docs
$(SITE)/.installed: requirements/docs.txt
	$(PYTHON) -m venv --clear $(SITE)
	$(SITE)/bin/python -m pip install --quiet --require-hashes -r requirements/docs.txt
	@touch $@

docs-tables: venv ## Write the keys and columns of all files into docs/run-folder.md
	$(BIN)/python -m expdesign.runfolder.documentation docs/run-folder.md

docs: $(SITE)/.installed ## Build the site of the documentation: build/site/index.html
	$(SITE)/bin/sphinx-build --quiet --fail-on-warning --keep-going --builder html \
	  --conf-dir docs --doctree-dir $(SITE)/doctrees . build/site

# Locked under the oldest Python that is supported: a newer one may pick releases it cannot install.
LOCK := $(BIN)/pip-compile --quiet --generate-hashes --allow-unsafe --strip-extras \
	--no-emit-index-url --no-emit-find-links --no-emit-trusted-host --no-emit-options
lock: export CUSTOM_COMPILE_COMMAND := make lock
lock: venv ## Lock the newest versions that pyproject.toml admits (needs Python 3.11)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
	  echo "make: the lock is made under Python 3.11: make clean lock PYTHON=python3.11" >&2; exit 1; }
	$(LOCK) --upgrade --build-deps-for wheel --output-file requirements/runtime.txt pyproject.toml
	$(LOCK) --upgrade --extra all --extra dev --constraint requirements/runtime.txt \
	  --output-file requirements/dev.txt pyproject.toml
	for group in docs mutants; do $(BIN)/python -c "import tomllib; \
	  print(*tomllib.load(open('pyproject.toml', 'rb'))['dependency-groups']['$$group'], sep='\n')" | \
	  $(LOCK) --upgrade --output-file requirements/$$group.txt - || exit 1; done

wheel: venv ## Build the wheel into dist/
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .

clean: ## Remove everything that was made here, except runs/
	rm -rf $(VENV) build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
