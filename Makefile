# Targets for a fresh machine: each makes the virtual environment by itself when it is missing or out of date.
PYTHON ?= python3
VENV := .venv
export OPENBLAS_NUM_THREADS := 1
BIN := $(VENV)/bin

.PHONY: demo examples test slow bench experiments fuzz soak lint clean

demo: $(VENV)/ready
	mkdir -p out
	$(BIN)/kumitate plan examples/wheel_support/task.yaml --output out/plan.json --replay out/replay.html

examples: $(VENV)/ready
	$(BIN)/python examples/run_all.py

test: $(VENV)/ready
	$(BIN)/python -m pytest -n 2

slow: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m slow

bench: $(VENV)/ready
	for bench in tests/bench/bench_*.py; do $(BIN)/python $$bench || exit 1; done

experiments: $(VENV)/ready
	$(BIN)/python tests/bench/experiments.py
	$(BIN)/python tests/bench/tunables.py
	$(BIN)/python tests/bench/costs.py

fuzz: $(VENV)/ready
	$(BIN)/python tests/fuzz/run.py

soak: $(VENV)/ready
	$(BIN)/python tests/bench/soak.py

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

$(VENV)/ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	  || { echo "Kumitate needs Python 3.11 to 3.13; name one with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]' >$(VENV)/install.log 2>&1 \
	  || { echo "The packages could not be installed: is there a network, and does pip reach a package index? (pip's words: $(VENV)/install.log)"; exit 1; }
	@touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info out
