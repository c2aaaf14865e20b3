# make book   build the book to _build/html          make test      what every change must pass, in minutes
# make check  lint, format, types, most unit tests   make test-all  that, and what takes longer
# make lab    open the notebooks in JupyterLab       make outputs   run the notebooks and store what they show
# make lock   pin all packages anew, with hashes     make wheel     build the package and try it by itself
# make live   the book, its cells run in the page    make bundle   the site as a zip, for a disk
# make pdf    the book on paper, in two volumes      make epub     the book for a reader
# make clean  remove what the build made
PYTHON ?= $(firstword $(foreach p,python3.11 python3.12 python3.13 python3 python,$(shell $(p) -c 'import sys, venv, ensurepip; sys.version_info >= (3, 11) and print("$(p)")' 2>/dev/null)))
REQUIREMENTS ?= requirements.txt
LOCK := $(if $(filter requirements.txt,$(REQUIREMENTS)),requirements.lock)
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
STAMP := .venv/installed
HTML := _build/html
RUN := $(BIN)/python tests/run.py
NOTEBOOKS := $(wildcard book/*.ipynb book/record/*.ipynb)

export LIVE  # 1: a book whose cells run in the reader's browser, with the files of `make live`

.PHONY: book html live test-live test test-all check pages notebooks lab outputs clean install lock mutation rows wheel pdf epub bundle

install: $(STAMP)

$(STAMP): $(REQUIREMENTS) $(LOCK) pyproject.toml
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer, with venv, is needed; name it with: make PYTHON=/path/to/python3"; exit 1; }
	@test -x $(BIN)/python || { echo "Making .venv with $(PYTHON)"; $(PYTHON) -m venv .venv; }
	@echo "Installing $(REQUIREMENTS) into .venv (a few minutes the first time)"
	@$(if $(LOCK),$(PIP) --no-deps --require-hashes -r $(LOCK))
	@$(PIP) $(if $(LOCK),--no-build-isolation) -r $(REQUIREMENTS)
	@touch $@

# Not torch: its wheels, and the CUDA packages they may need, differ from machine to machine.
TORCH_NEEDS := filelock fsspec jinja2 networkx setuptools sympy typing-extensions
lock:
	@$(PYTHON) -m venv _build/lock
	@_build/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	@{ grep -v '^torch==' requirements.txt; printf '%s\n' $(TORCH_NEEDS); } | _build/lock/bin/uv pip compile --quiet --upgrade \
		--universal --python-version 3.11 --generate-hashes --no-emit-package rlcore --no-annotate \
		--custom-compile-command "make lock" - --output-file requirements.lock

book: html
	@echo
	@echo "The book is built. Open file://$(CURDIR)/$(HTML)/index.html"

# -W: a warning fails the build; -n: so does a reference that leads nowhere
html: $(STAMP)
	@$(BIN)/jupyter-book build . -W -n --keep-going

# the same with cells that run in the page, on what is fetched once, by hash; serve it: python -m http.server -d _build/html
live: $(STAMP)
	@$(BIN)/python book/_live/fetch.py
	@$(MAKE) --no-print-directory book LIVE=1

# every cell and every exercise in the page, in Chromium (an hour)
test-live: live
	@.ci/browser
	@$(BIN)/python tests/live_seconds.py
	@$(RUN) live

# Out of the built pages, into _build/paper; SIZES="A4 Letter" makes both
SIZES ?= A4
pdf: html
	@.ci/browser
	@$(BIN)/python book/_paper/pdf.py $(SIZES)

epub bundle: html
	@$(BIN)/python book/_paper/$@.py

test: $(STAMP)
	@.ci/browser
	@$(RUN) lint unit html pages narrow blas

test-all: $(STAMP)
	@.ci/browser
	@$(RUN) lint unit html pages slow narrow single double wheel

check: $(STAMP)
	@$(RUN) lint quick

pages: $(STAMP)
	@.ci/browser
	@$(RUN) html pages

notebooks: $(STAMP)
	@$(RUN) narrow blas

lab: $(STAMP)
	@$(BIN)/jupyter lab book

outputs: $(STAMP)
	@$(BIN)/python book/_ext/outputs.py $(NOTEBOOKS)

# break every line on purpose: a test must fail (about an hour, resumable)
mutation: $(STAMP)
	@$(BIN)/python tests/mutation.py
	@$(BIN)/python tests/mutation_exercises.py
	@$(BIN)/python tests/mutation_exercises.py --named

# break the code once or more for each row of the ledger: its own check must notice (an hour, resumable)
rows: $(STAMP)
	@$(BIN)/python tests/rows.py

# wheel and sdist in _build/dist, tried in an environment that has nothing else
wheel:
	@$(PYTHON) tests/release.py

clean:
	rm -rf _build .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
