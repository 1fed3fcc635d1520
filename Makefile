# Everything sets itself up: all that is needed is make and Python 3.10 to 3.13 (`make demo PYTHON=python3.12` chooses one).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# A file's tests stay together on one core: they share what is dear to make.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile
CODE := src tests benchmarks examples

.PHONY: help setup demo test slow examples lint types check bench clean

help:  ## say what there is to make
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | sort | expand -t 10

setup: $(STAMP)  ## make .venv and install blendcap in it (again only when pyproject.toml has changed)

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] < (3, 14))' \
	  || { echo "blendcap needs Python 3.10 to 3.13; name one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' \
	  || { echo "This Python cannot make environments; install its venv package (Debian, Ubuntu: apt install python3-venv)." >&2; exit 1; }
	@echo "Setting up $(VENV) (a minute or two, once)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@echo "Compiling the solvers (a minute, once)"
	@$(BIN)/blendcap doctor >$(VENV)/doctor.txt || { cat $(VENV)/doctor.txt; exit 1; }
	@touch $@

demo: $(STAMP)  ## the whole marker pipeline on the embedded mannequin, into demo/
	@$(BIN)/blendcap demo --out demo

test: $(STAMP)  ## the quick tests
	@$(PYTEST)

slow: $(STAMP)  ## the slow tests
	@$(PYTEST) -m slow --ignore tests/test_examples.py

examples: $(STAMP)  ## run every example
	@$(BIN)/python -m pytest -m slow tests/test_examples.py

lint: $(STAMP)  ## style, format and the floors of the house
	@$(BIN)/ruff check $(CODE)
	@$(BIN)/ruff format --check $(CODE)
	@$(BIN)/lint-imports

types: $(STAMP)  ## pyright
	@$(BIN)/pyright

check: lint types test  ## what to run before a commit

bench: $(STAMP)  ## the benchmarks of the solves, with every peer; RESULTS.md names the commands of all
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[bench]'
	@$(BIN)/python benchmarks/box_solvers.py
	@$(BIN)/python benchmarks/accuracy.py

clean:  ## remove what was built
	rm -rf $(VENV) demo build dist .pytest_cache .ruff_cache .import_linter_cache
