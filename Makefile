# Two commands are all a newcomer needs: `make demo` and `make test`. Both build .venv when it is missing or outdated.
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell command -v python3.11 || command -v python3)
PIP := $(BIN)/python -m pip --disable-pip-version-check

.PHONY: demo how-long test docs quick test-cpus test-data test-oldest dist bench sizes notebooks env lint clean help

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

demo: how-long env  ## collect 220 samples, train the classifier, write report and viewer file
	$(BIN)/svfl-collect centering --episodes 220 --seed 0 --workers 2 --out data/centering
	$(BIN)/svfl-train centering --data data/centering --encoder vf --model svfl --train-samples 100 --valid-samples 20 --patience 60 \
	  --seed 0 --out out/centering
	$(BIN)/svfl-data view data/centering --episode 3 --out out/centering/episode_000003.rrd

# Before `env`, so that it stands before the installation begins.
how-long:
	@echo "make demo: on two idle cores about 2 minutes for the installation into $(VENV), once, and the download of its packages;"
	@echo "then about 1 minute to collect, train and write the report"

test: env lint  ## ruff, mypy and the whole test suite
	$(BIN)/python -m pytest -n 2

docs: $(VENV)/installed-docs  ## the documentation as a site, out/site; a broken link or docstring is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

quick: env  ## the tests without the slow ones: about two minutes on two idle cores
	$(BIN)/python -m pytest -n 2 -m "not slow"

test-cpus: env  ## the quick tests as other processors would run them (tests/helpers/cpu_settings.py)
	$(BIN)/python -m tests.helpers.cpu_settings -n 2 -m "not slow"

test-data:  ## the data package's tests without any extra, on another Python: make test-data PYTHON=python3.14
	$(PYTHON) -m venv --clear build/data
	build/data/bin/python -m pip install --quiet --editable . pytest pytest-xdist hypothesis psutil
	build/data/bin/python -m pytest -n 2 -m "not slow" --partial tests/svfl_data

test-oldest:  ## the quick tests with the oldest versions that pyproject.toml allows
	$(PYTHON) -m venv --clear build/oldest
	$(PYTHON) -m tests.helpers.oldest_versions > build/oldest/constraints.txt
	build/oldest/bin/python -m pip install --quiet --constraint build/oldest/constraints.txt --editable '.[all,onnx,ray,notebooks]'
	build/oldest/bin/python -m pip install --quiet --no-deps escnn==1.0.11
	build/oldest/bin/python -m pip install --quiet pytest pytest-xdist hypothesis psutil pypdfium2
	build/oldest/bin/python -m pytest -n 2 -m "not slow"

dist: env  ## source distribution and wheel, in dist/
	$(BIN)/python -m build --no-isolation

bench: env data/centering data/block_picking  ## every benchmark; figures for docs/benchmarks.md
	$(BIN)/python benchmarks/collect.py
	$(BIN)/python benchmarks/workers.py
	$(BIN)/python benchmarks/experts.py
	$(BIN)/python benchmarks/render.py
	$(BIN)/python benchmarks/models.py
	$(BIN)/python benchmarks/precision.py
	$(BIN)/python benchmarks/inference.py
	$(BIN)/python benchmarks/record.py
	$(BIN)/python benchmarks/store.py --data data/centering
	$(BIN)/python benchmarks/replay.py --data data/block_picking
	$(BIN)/python benchmarks/latent.py

sizes: env data/centering data/centering_test  ## accuracy and training time by width and group; takes hours
	$(BIN)/python benchmarks/sizes.py --data data/centering --separate-test data/centering_test --out out/sizes

data/centering: | env
	$(BIN)/svfl-collect centering --episodes 200 --seed 0 --workers 2 --out $@

data/centering_test: | env
	$(BIN)/svfl-collect centering --episodes 1000 --seed 1 --workers 2 --out $@

data/block_picking: | env
	$(BIN)/svfl-collect expert --task block_picking --episodes 50 --seed 0 --workers 2 --out $@

notebooks: env  ## run the notebooks and store what they show
	$(BIN)/python notebooks/refresh.py

lint: env  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

env: $(VENV)/installed  ## build the environment in .venv

# The mark is touched last, so an interrupted installation is taken up again by the next make.
$(VENV)/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { \
	  echo "the whole environment needs Python 3.11 (pybullet has no wheels for later ones); found $$($(PYTHON) --version 2>&1) at $(PYTHON); run: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --constraint constraints.txt --editable '.[all,dev]'
	$(PIP) install --quiet --constraint constraints.txt --no-deps escnn
	@touch $@

$(VENV)/installed-docs: $(VENV)/installed
	$(PIP) install --quiet --constraint constraints.txt --editable '.[docs]'
	@touch $@

clean:  ## remove the environment and everything the demo wrote
	rm -rf $(VENV) out data/centering
