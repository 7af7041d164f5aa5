# `make demo` and `make test` install everything that they need into .venv. They need Python 3.11, pip and make.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet
# Every process would translate all of JAX anew without the bytecode of Python, which takes a second.
export PYTHONDONTWRITEBYTECODE :=
# Number of parallel test processes. The threads of numpy and XLA are not limited.
WORKERS ?= 2
# A test that ends its process is told: by default it would be tried again, in a new process, without end.
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --max-worker-restart 0 --dist loadfile --no-loadscope-reorder
# The second tier of the tests; see CONTRIBUTING.md.
SECOND := every_combination
EXAMPLES := column_collapse settling fluidised_bed injection friction_calibration train_closure

.PHONY: demo test test-rest test-all pytest lint docs examples coverage dist dist-check clean

demo: $(VENV)/run.done
	$(BIN)/jaxdem study clusters --scale demo --out runs/demo

# The types are checked beside the tests: alone they would keep one core waiting.
test: $(VENV)/test.done
	$(MAKE) --no-print-directory --jobs 2 lint pytest

pytest: $(VENV)/test.done
	$(PYTEST) --durations 10 -m "not $(SECOND)"

# What `make test` leaves out: combinations of options, each of which it tests by itself.
test-rest: $(VENV)/test.done
	$(PYTEST) --durations 10 -m $(SECOND)

test-all: test
	$(MAKE) --no-print-directory test-rest

lint: $(VENV)/test.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The site, in build/site. It can be opened as files, search included.
docs: $(VENV)/docs.done
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# Run the examples and renew their pictures in docs/pictures.
examples: $(VENV)/run.done
	for name in $(EXAMPLES); do $(BIN)/python examples/$$name.py docs/pictures/$$name.png || exit 1; done

# Coverage of all tests, report in build/coverage. Lines that run only in processes that are killed are not counted.
coverage: $(VENV)/test.done
	$(PYTEST) --cov=jaxdem --cov-report=term-missing:skip-covered --cov-report=html:build/coverage

dist: $(VENV)/test.done
	rm -rf dist build/lib build/bdist.*
	$(BIN)/python -m build --outdir dist .

dist-check:
	.ci/dist_check

clean:
	rm -rf $(VENV) runs build dist *.egg-info

$(VENV)/run.done: constraints.txt pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --no-deps -r constraints.txt
	$(PIP) --no-deps --editable .
	touch $@

$(VENV)/test.done: $(VENV)/run.done constraints-test.txt
	$(PIP) --no-compile --no-deps -r constraints-test.txt
	touch $@

$(VENV)/docs.done: $(VENV)/run.done constraints-docs.txt
	$(PIP) --no-compile --no-deps -r constraints-docs.txt
	touch $@
