# `make demo` and `make test` do all their setting up themselves: a virtual environment in .venv, the viewer's
# packages, Node and Chromium when the system has none.

PYTHON ?= $(firstword $(foreach name,python3.14 python3.13 python3.12 python3.11 python3,$(if $(shell \
	$(name) -c 'import sys; sys.version_info >= (3, 11) and print(1)' 2>/dev/null),$(name))))
BIN := .venv/bin
INSTALLED := .venv/.farfield-installed
VIEWER := src/farfield/serve/static/index.html
VIEWER_SOURCES := $(shell find viewer -name node_modules -prune -o -type f -print 2>/dev/null)
HAS_VIEWER := $(wildcard viewer/package.json)
PYTEST_FLAGS ?=

.PHONY: demo test lint format bench clean setup viewer chromium check-viewer

demo: setup
	$(BIN)/farfield demo

test: setup chromium lint check-viewer
	$(BIN)/python -m pytest $(PYTEST_FLAGS)

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: setup
	$(BIN)/farfield bench all

clean:
	rm -rf .venv viewer/node_modules src/farfield/serve/static build dist .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

setup: $(INSTALLED) viewer

$(INSTALLED): pyproject.toml hatch_build.py
	@test -n "$(PYTHON)" || { echo "farfield needs Python 3.11 or later: apt-get install python3 python3-venv"; exit 1; }
	PYTHON="$(PYTHON)" sh scripts/virtualenv.sh
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

viewer: $(if $(HAS_VIEWER),$(VIEWER))

$(VIEWER): $(VIEWER_SOURCES) scripts/viewer.py | $(INSTALLED)
	$(BIN)/python scripts/viewer.py build
	touch $@

check-viewer: setup
ifneq ($(HAS_VIEWER),)
	$(BIN)/python scripts/viewer.py typecheck test
endif

# BROWSER=no leaves the tests in a real browser out.
chromium: $(INSTALLED)
ifeq ($(BROWSER),no)
	@echo "BROWSER=no: tests in a real browser are left out"
else
	@PYTHON=$(BIN)/python sh scripts/chromium.sh
endif
ifeq ($(BROWSER),no)
test: PYTEST_FLAGS += -m "not browser and not slow"
endif
