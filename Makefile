# make demo   set up and render a picture
# make test   set up, lint, type-check and run the tests
# make bench  set up and write the report pages
# make docs   set up and build the documentation in build/docs
# make mutants  seed faults one at a time and tell which the tests notice; about two hours; AREAS="warp points" for some,
#               CHANCE=3 for faults by chance, SEED=1 for others of those
# make serve  set up and start the service on http://127.0.0.1:8000; PORT=8080 for another port
#
# PYTHON=python3.12      another interpreter (3.10 or newer) for the virtual environment
# TORCH_INDEX=URL        a package index with CPU-only builds of torch, for a smaller download

PYTHON ?= python3
VENV ?= .venv
TORCH_INDEX ?=
PORT ?= 8000

# Threads that spin while they wait make torch several times slower on a busy machine.
export OMP_WAIT_POLICY ?= PASSIVE

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
DEMO := out/demo.png

.PHONY: demo test mutants bench docs docs-setup serve page setup clean

# Kernels are compiled by the picture itself, on all cores, while its scene is made.
demo: setup
	@mkdir -p $(dir $(DEMO))
	@begin=$$(date +%s); \
	$(BIN)/torchrender render living_room --supersample 2 -o $(DEMO) && \
	echo "Rendered $(CURDIR)/$(DEMO) in $$(( $$(date +%s) - begin )) s"

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tests/side_by_side.py

# Apart from "make test"; what was found is kept in build/mutants.jsonl, so it goes on where it was stopped.
mutants: setup
	$(BIN)/python -m tests.mutants $(AREAS) --chance $(or $(CHANCE),0) --seed $(or $(SEED),0)

serve: setup
	$(BIN)/torchrender serve --port $(PORT)

# After a change of static/js; needs node, which nothing else does. What it makes is kept in the repository.
page:
	cd service/torchrender_service/static && for part in js/main.js:page js/decode-worker.js:decode-worker js/fog/main.js:fog; do \
	  npx --yes esbuild@0.28.2 $${part%%:*} --bundle --minify --format=esm --target=es2022 --legal-comments=eof \
	    --outfile=bundle/$${part##*:}.js; done
	python3 service/note_page_sources.py

bench: $(VENV)/.stamp-bench
	$(BIN)/python -m torchrender.report.foundation

docs: docs-setup
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "Built $(CURDIR)/build/docs/index.html"

docs-setup: $(VENV)/.stamp-docs

setup: $(VENV)/.stamp

# torch first: it is the largest download and the only one that may come from an index of its own.
$(VENV)/.stamp: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("torchrender needs Python 3.10 or newer" if sys.version_info < (3, 10) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) -c constraints.txt torch==2.13.0
	$(PIP) install --quiet -c constraints.txt -e '.[test]'
	@touch $@

$(VENV)/.stamp-bench: $(VENV)/.stamp
	$(PIP) install --quiet -c constraints.txt -e '.[bench]'
	@touch $@

$(VENV)/.stamp-docs: $(VENV)/.stamp
	$(PIP) install --quiet -c constraints.txt -e '.[docs]'
	@touch $@

clean:
	rm -rf $(VENV) out build .mypy_cache .ruff_cache .pytest_cache
