# make demo   sets up .venv and renders the shipped demo to demo.mp4
# make test   sets up .venv and runs the checks and the whole test suite
# make test-matrix   runs the suite under four instruction sets, each in another order
# make benchmarks [CLIPS=folder]   measures what code or weights have changed for, and writes docs/benchmarks.md
#
# Only the tests, training and CUDA take PyTorch. On Linux, PyPI's brings CUDA; name another build to spare the gigabytes:
#   make test TORCH="torch==2.13.0 --index-url <PyTorch's index of CPU builds>"
PYTHON ?= python3.11
TORCH ?= torch
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --constraint constraints.txt
# The poster's corners in the demo clip's first frame.
QUAD := 476.3,128.1 759.4,121.6 758.8,479.7 481.7,476.3

demo: .venv/installed
	$(BIN)/ar-replace assets/demo.mp4 assets/ad.mp4 --quad $(QUAD) -o demo.mp4 --overwrite

test: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m pytest

test-matrix: .venv/installed-dev
	$(BIN)/python -m tests.matrix

benchmarks: .venv/installed-dev
	$(BIN)/python -m ar_demo.evaluation.report $(CLIPS)

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(INSTALL) --editable .
	touch $@

.venv/installed-dev: .venv/installed
	$(INSTALL) --no-deps $(TORCH)
	$(INSTALL) --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv

.PHONY: demo test test-matrix benchmarks clean
