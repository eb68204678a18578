# Every target sets up what it needs: a .venv with the versions pinned in requirements.lock.
# Needs Python >= 3.11 with venv, make and a package index. `make PYTHON=python3.13 test` picks another.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
OUT ?= demo-run
JOBS ?= 2

.PHONY: demo test test-all quick check docs bench studies mutate lock clean
.DEFAULT_GOAL := demo

$(READY): requirements.lock pyproject.toml $(wildcard procam/kernels/*/*.[ch])
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "procam needs Python >= 3.11, got %s.%s; try: make PYTHON=python3.11" % sys.version_info[:2])'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

demo: $(READY)
	$(BIN)/procam demo --out $(OUT)

# each process of the tests has a core of its own: threads that wait for another's core made it 17 minutes.
# bytecode is kept whatever the environment says: without it each command that a test starts compiles procam
ALONE := OPENBLAS_NUM_THREADS=1 OMP_WAIT_POLICY=passive PYTHONDONTWRITEBYTECODE=
PYTEST = $(ALONE) $(BIN)/python -m pytest -n $(JOBS) --dist worksteal

# all but what takes long and rarely fails (LONG in tests/conftest.py)
test: $(READY)
	$(PYTEST) -m "not long" $(PYTEST_FLAGS)

test-all: $(READY)
	$(PYTEST) $(PYTEST_FLAGS)

quick: $(READY)
	$(ALONE) $(BIN)/python tests/quick.py

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -q tests/test_mutations.py

docs: $(READY)
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

bench: $(READY)
	$(BIN)/python -m benchmarks

studies: $(READY)
	$(BIN)/python -m studies

mutate: $(READY)
	JOBS=$(JOBS) $(BIN)/python -m mutations

# Remakes requirements.lock from pyproject.toml (versions and hashes only, no index address).
lock:
	$(PYTHON) -m venv .venv-lock
	.venv-lock/bin/python -m pip install --quiet uv
	.venv-lock/bin/uv pip compile pyproject.toml --universal --python-version 3.11 --extra geom --extra report --extra sim --extra video --group dev --group docs \
	  --generate-hashes --no-emit-index-url --no-annotate --no-header --quiet --output-file requirements.lock
	rm -rf .venv-lock

clean:
	rm -rf .venv .venv-lock build demo-run docs/_build *.egg-info procam/kernels/_native*
