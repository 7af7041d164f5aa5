# make demo and make test set up everything they need on a machine with Python 3.11, pip and make.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet --no-compile
# Threads of the libraries that numpy and XLA use are left alone; two test processes share two cores.
WORKERS ?= 2

.PHONY: demo test lint clean

demo: $(VENV)/run.done
	$(BIN)/jaxdem study injection --scale demo --out runs/demo

test: $(VENV)/test.done lint
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --durations 10

lint: $(VENV)/test.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

clean:
	rm -rf $(VENV) runs build *.egg-info

$(VENV)/run.done: constraints.txt pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps -r constraints.txt
	$(PIP) --no-deps --editable .
	touch $@

$(VENV)/test.done: $(VENV)/run.done constraints-test.txt
	$(PIP) --no-deps -r constraints-test.txt
	touch $@
