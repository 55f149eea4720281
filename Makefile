# moveit6d: everything starts here. No root needed; all of it goes into .venv and demo.
#
#   make install    what tracking needs, pinned, in a virtual environment; leaves .venv/bin/moveit6d
#   make demo       makes a clip of an object never seen in training, follows it, prints the error
#   make demo-real  the same on a real video (ViSP's test sequence of a cube)
#   make test       install everything (all extras), lint, tests
#   make lint       ruff, formatting, mypy, typos, large files, retired words
#   make docs       the documentation as a site in build/site; warnings are errors

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.moveit6d-installed
ALL := $(VENV)/.moveit6d-all

# The CPU build of torch saves gigabytes where pip would take the one for NVIDIA cards: set
# TORCH_INDEX to the address of PyTorch's index of CPU wheels (see its installation page).
TORCH_INDEX ?=

# Tests run in so many processes beside each other, each on one thread.
TEST_PROCESSES ?= 2

export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: install demo demo-real test lint docs clean
.DELETE_ON_ERROR:

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { \
	    echo "No $(PYTHON) here. Install Python 3.11 or newer, or name one: make PYTHON=/path/to/python3" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "moveit6d needs Python 3.11 or newer; name one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@echo "Setting up $(VENV): torch and what it needs; a few minutes the first time …"
	@PYTHON=$(PYTHON) tools/make_venv.sh $(VENV)
	@$(BIN)/python -m pip install --quiet --no-deps --constraint constraints.txt \
	    $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) torch
	@$(BIN)/python -m pip install --quiet --use-pep517 --constraint constraints.txt --editable .
	@touch $@
	@echo "Installed. The command is $(BIN)/moveit6d"

$(ALL): $(STAMP)
	@echo "Adding the extras (training, OpenGL, reports, rerun, ray) and what tests need …"
	@$(BIN)/python -m pip install --quiet --use-pep517 --constraint constraints.txt --editable '.[all,dev]'
	@touch $@

demo: $(STAMP)
	$(BIN)/moveit6d demo --output demo

demo-real: $(STAMP) demo/visp/.unpacked
	$(BIN)/python examples/track_visp_cube.py --visp demo/visp --output demo/real

demo/visp/.unpacked:
	tools/unpack_debian_package.sh visp-images-data demo/visp
	@touch $@

lint: $(ALL)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/typos
	$(BIN)/python tools/large_files.py
	$(BIN)/python tools/retired_words.py

docs: $(VENV)/.moveit6d-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "Open build/site/index.html"

$(VENV)/.moveit6d-docs: $(ALL)
	@$(BIN)/python -m pip install --quiet --use-pep517 --constraint constraints.txt --editable '.[all,dev,docs]'
	@touch $@

test: lint
	$(BIN)/python -m pytest --numprocesses $(TEST_PROCESSES) --dist worksteal

clean:
	rm -rf $(VENV) demo build dist .pytest_cache .mypy_cache .ruff_cache
