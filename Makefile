# The user's two commands, the one test command, and the developer's daily ones: `make help` lists them.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet
DEMO   ?= demo
DATA   ?= $(or $(STEREOPSIS_DATA),../shared/data)

# What the compiled core is made from.
CORE := pyproject.toml CMakeLists.txt $(shell find cpp -name tests -prune -o -type f -print)
CODE := src tests benchmarks docs examples
VIEW := $(wildcard tests/test_view*.py)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:  # the stamps below are made in order
.PHONY: help setup demo test lint format types imports cpp-test py-test view-test browser docs wheel bench accuracy clean

help:  ## list these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

# For users

setup: $(VENV)/.user  ## make .venv with the package and what its study and its page need in it
	@echo "Ready: $(BIN)/stereopsis --help"

demo: $(VENV)/.user  ## render a street scene, match it, score it, write everything into demo/
	$(BIN)/stereopsis demo -o $(DEMO)

# For developers

test: lint types imports cpp-test browser py-test  ## everything that must hold before a change lands

lint: $(VENV)/.dev  ## rules and formatting of the Python code
	$(BIN)/ruff check $(CODE)
	$(BIN)/ruff format --check $(CODE)

format: $(VENV)/.dev  ## mend what lint can mend
	$(BIN)/ruff check --fix $(CODE)
	$(BIN)/ruff format $(CODE)

types: $(VENV)/.dev $(VENV)/.user  ## mypy, strict
	$(BIN)/mypy

imports: $(VENV)/.dev $(VENV)/.user  ## who may import whom
	$(BIN)/lint-imports

cpp-test: $(VENV)/.dev  ## the kernels' tests, under the address and undefined-behaviour sanitizers
	$(BIN)/cmake -S . -B build/cpp -G Ninja -DCMAKE_MAKE_PROGRAM=$(abspath $(BIN))/ninja \
		-DSTEREOPSIS_TESTS=ON -DSTEREOPSIS_SANITIZE=ON
	$(BIN)/cmake --build build/cpp
	$(BIN)/ctest --test-dir build/cpp --output-on-failure --no-tests=error

py-test: $(VENV)/.dev $(VENV)/.user  ## the library's tests
	$(BIN)/python -m pytest

view-test: browser $(VENV)/.dev $(VENV)/.user  ## the tests of the page and its server, in a real browser
	$(BIN)/python -m pytest $(VIEW)

browser:  ## install Chromium where there is none; the page is tested in it
	sh tools/browser.sh

docs: $(VENV)/.dev $(VENV)/.user  ## build docs/_build/html, warnings are errors
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

# The environment is new and the demo runs elsewhere, so nothing can be borrowed from the checkout.
wheel: $(VENV)/.dev  ## build sdist and wheel; try the wheel in an empty environment
	rm -rf dist build/empty
	$(BIN)/python -m build --outdir dist
	$(PYTHON) -m venv build/empty
	build/empty/bin/python -m pip --disable-pip-version-check --quiet install dist/*.whl
	cd / && $(abspath build/empty)/bin/stereopsis demo -o $(abspath build/empty)/demo

bench: $(VENV)/.bench  ## speed and memory against OpenCV
	$(BIN)/python benchmarks/speed.py

accuracy: $(VENV)/.dev $(VENV)/.user  ## the accuracy table on the real pairs, found in DATA
	$(BIN)/stereopsis bench accuracy $(DATA)/drivingstereo $(DATA)/kitti2015 $(DATA)/middlebury-v3

clean:  ## remove what was built; .venv stays
	rm -rf build dist demo docs/_build docs/api/generated .pytest_cache .mypy_cache .ruff_cache \
		.hypothesis .import_linter_cache

# Stamps: the package with what a user needs, what a developer adds, what a benchmark adds.

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# pip builds in an environment of its own; with the developer's tools at hand, only what changed is compiled.
$(VENV)/.user: $(BIN)/python $(CORE)
	@if [ -e $(VENV)/.dev ]; \
		then $(PIP) install --no-build-isolation --no-deps --editable .; \
		else $(PIP) install --editable '.[study,view,cluster]'; fi
	@touch $@

$(VENV)/.dev: $(BIN)/python pyproject.toml
	$(PIP) install --editable '.[dev]'
	@touch $(VENV)/.user $@

$(VENV)/.bench: $(VENV)/.dev $(VENV)/.user
	$(PIP) install --no-build-isolation --editable '.[bench]'
	@touch $@
