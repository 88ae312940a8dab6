# make demo        the main job on built-in runs, and where its report is
# make test        format, lint, types and all tests but the long ones
# make test-long   the long tests, on all cores; SHARD=1/4: the first of four parts, MINUTES=12: what begins within
# make test-lowest make test with the lowest versions that pyproject.toml allows
# make docs        the site of the documentation, and where it is
# Everything is installed into .venv, again only when pyproject.toml changed.
# Another interpreter: make PYTHON=python3.12 demo

PYTHON ?= python3
BIN := .venv/bin
# Modules are compiled when they are first used: all of them are a third of the time of an install.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
TYPES := $(BIN)/mypy --no-error-summary -p zerobeam

# The tests start the program many times over: compiled once, by whoever comes first.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-long test-lowest docs lint style format clean
.DELETE_ON_ERROR:

demo: .venv/installed
	@$(BIN)/zerobeam demo

# Types and the app's page are checked beside the tests; what was found is told below theirs.
test: style
	@{ $(TYPES) && .ci/page/check; } >build/beside.txt 2>&1 & beside=$$!; \
	$(BIN)/pytest -n auto --dist worksteal -m "not long"; tests=$$?; \
	wait $$beside || tests=1; cat build/beside.txt; exit $$tests

test-long: .venv/installed-test
	@$(BIN)/pytest -n auto --dist worksteal -m long $(if $(SHARD),--shard $(SHARD)) $(if $(MINUTES),--minutes $(MINUTES))

test-lowest: .venv-lowest/installed-test
	@.venv-lowest/bin/pytest -n auto --dist worksteal -m "not long"

docs: .venv/installed-docs
	@$(BIN)/python docs/build.py

# The page of the app is checked where Node is.
lint: style
	@$(TYPES)
	@.ci/page/check

# mypy wants to find the package under its name, and an editable install hides it: link the rooms.
style: .venv/installed-test
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check .
	@rm -rf build/typing && mkdir -p build/typing/zerobeam
	@for part in $(filter-out setup.py,$(wildcard *.py)) py.typed $(dir $(wildcard */__init__.py)); do \
		ln -s "$(CURDIR)/$${part%/}" build/typing/zerobeam/; done
	@PYTHONPATH=build/typing $(BIN)/lint-imports --no-cache --no-logo >build/imports.txt || \
		{ cat build/imports.txt; exit 1; }

format: .venv/installed-test
	@$(BIN)/ruff check --quiet --fix .
	@$(BIN)/ruff format --quiet .

clean:
	rm -rf .venv .venv-lowest build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis

.venv/bin/python:
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "zerobeam needs Python 3.11 or later, but there is no '$(PYTHON)'." \
		"Say which one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "zerobeam needs Python 3.11 or later, but '$(PYTHON)' is $$("$(PYTHON)" --version 2>&1)." \
		"Say which one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@"$(PYTHON)" -m venv .venv

.venv/installed: pyproject.toml | .venv/bin/python
	@echo "Installing zerobeam into .venv (once)…"
	@$(PIP) --editable .
	@touch $@

.venv/installed-test: pyproject.toml | .venv/bin/python
	@echo "Installing zerobeam and its test tools into .venv (once)…"
	@$(PIP) --editable '.[test]'
	@touch .venv/installed $@

# The tools of the tests are not held: it is what users install that has to work at its lowest.
.venv-lowest/installed-test: pyproject.toml .ci/lowest.py | .venv/bin/python
	@echo "Installing the lowest versions into .venv-lowest (once)…"
	@"$(PYTHON)" -m venv .venv-lowest
	@$(BIN)/python .ci/lowest.py >.venv-lowest/lowest.txt
	@.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check --requirement .venv-lowest/lowest.txt
	@.venv-lowest/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	@touch $@

.venv/installed-docs: pyproject.toml | .venv/bin/python
	@echo "Installing zerobeam and the site's generator into .venv (once)…"
	@$(PIP) --editable '.[docs]'
	@touch .venv/installed $@
