# From a fresh clone: `make demo` runs the main job on a simulated rig, `make test` runs every check.
# Each target sets up what it needs; the environment is .venv, the Debian packages are in scripts/system-packages.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_OUT ?= demo_out
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: translations help docs setup system system-test gentl demo demo-quick test lint types imports unit checks producer test-slow explore peers clean constraints

help:
	@echo "make demo        a whole collect on a simulated rig, focused, calibrated, fused: $(DEMO_OUT)/report.html"
	@echo "make demo-quick  the same with fewer positions (under 40 s)"
	@echo "make test        lint, types, import rules and all tests"
	@echo "make test-slow   losses of many seconds, clock drift and the like"
	@echo "make explore     properties of the numerics with other examples each time, ROUNDS of them (5)"
	@echo "make peers       every comparison with other people's programs, as one table (those that are installed)"
	@echo "make docs        web pages of docs/ and of every module: build/docs/index.html"
	@echo "make setup       only the environment"
	@echo "make gentl       the GenTL producer for GigE Vision cameras, over Aravis: build/gentl/polfuse-aravis.cti"
	@echo "make translations LANGUAGE=de  the texts of the window for a translator, and what is translated for the window"
	@echo "make constraints pin the dependencies anew from pyproject.toml (needs uv)"

system:
	@sh scripts/system-packages

system-test:
	@sh scripts/system-packages test

gentl:
	@sh scripts/build-gentl

$(BIN)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' || \
	  { echo "PolFuse Lab needs Python 3.11 to 3.13; name one with 'make PYTHON=python3.11 ...'"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes -r constraints.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

# Compiles the numerics.
$(BIN)/.ready: $(BIN)/.installed
	$(BIN)/python -m polfuse_lab.warm_up
	@touch $@

setup: system $(BIN)/.ready

demo: setup
	$(BIN)/polfuse demo --out $(DEMO_OUT)

demo-quick: setup
	$(BIN)/polfuse demo --out $(DEMO_OUT) --quick

# Numerics are compiled and the producer is built while the sources are checked.
test: system-test $(BIN)/.installed
	+@$(MAKE) --no-print-directory -j 2 --output-sync=target $(BIN)/.ready producer checks
	+@$(MAKE) --no-print-directory unit

checks: lint types imports

lint: $(BIN)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(BIN)/.installed
	$(BIN)/mypy

imports: $(BIN)/.installed
	$(BIN)/lint-imports

# The numerics fill both cores; after them come the tests that talk to devices in real time, which mostly wait. These can
# fail when the machine is kept busy by others: what failed is run once more, alone. A defect fails again.
unit: $(BIN)/.ready producer
	$(BIN)/pytest -n 2 -m "not slow and not realtime"
	$(BIN)/pytest -n 3 --dist loadfile -m "realtime and not slow" || \
	  $(BIN)/pytest -m "realtime and not slow" --last-failed --last-failed-no-failures none

# The GenTL producer where it can be built; without it the tests of cameras over it are skipped with the reason.
producer:
	@case "$$(uname -s)" in Linux) sh scripts/build-gentl || echo "the GenTL producer was not built" ;; esac

# Pages are written anew where something changed; a warning is an error.
docs: $(BIN)/.ready
	@$(BIN)/python -c 'import myst_parser, sphinx' 2>/dev/null || $(BIN)/python -m pip install --quiet --editable '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "build/docs/index.html"

# Tests that take long: clock drift, losses of many seconds.
test-slow: setup
	$(BIN)/pytest -m slow

# Properties with other examples each time; what fails is printed with its example, and is worth a test of its own.
explore: setup
	for round in $$(seq $(or $(ROUNDS),5)); do \
	  $(BIN)/pytest -n 2 -q -m "hypothesis and not slow and not realtime" --hypothesis-profile explore || exit 1; \
	done

# Programs that are missing are told, not compared; QUICK=--quick takes a short version of each.
peers: setup
	$(BIN)/python -m benchmarks --peers $(QUICK)

constraints:
	uv pip compile pyproject.toml --extra camera --extra zaber --extra test --extra build --extra docs --universal --python-version 3.11 \
	  --generate-hashes --no-emit-index-url --no-annotate --no-header -o constraints.txt

# The window's texts for a translator (Qt Linguist opens the file), and what is translated for the window.
translations: $(BIN)/.ready
	@test -n "$(LANGUAGE)" || { echo "name the language: make translations LANGUAGE=de"; exit 1; }
	mkdir -p gui/translations
	$(BIN)/pyside6-lupdate $$(find gui -name '*.py') -ts gui/translations/polfuse_$(LANGUAGE).ts
	$(BIN)/pyside6-lrelease gui/translations/polfuse_$(LANGUAGE).ts

clean:
	rm -rf $(VENV) $(DEMO_OUT) build *.egg-info
