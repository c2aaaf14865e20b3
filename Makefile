# make book   build the book to _build/html          make test    everything that continuous integration checks
# make check  lint, format and unit tests, quickly   make lab     open the notebooks in JupyterLab
# make outputs  run the notebooks and store what they show        make clean   remove what the build made
PYTHON ?= $(firstword $(foreach p,python3.11 python3.12 python3.13 python3 python,$(shell $(p) -c 'import sys, venv, ensurepip; sys.version_info >= (3, 11) and print("$(p)")' 2>/dev/null)))
REQUIREMENTS ?= requirements.txt
LOCK := $(if $(filter requirements.txt,$(REQUIREMENTS)),requirements.lock)
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
STAMP := .venv/installed
HTML := _build/html
NOTEBOOKS := $(wildcard book/*.ipynb)
EXERCISES := $(wildcard book/exercises/*.ipynb)
NBVAL := $(BIN)/pytest --nbval --nbval-current-env --nbval-sanitize-with tests/nbval.cfg -n 2 --dist loadfile

THREADS_1 := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1
THREADS_2 := OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 NUMBA_NUM_THREADS=2
# numpy's wide vector units off (its names for them), an old kernel for OpenBLAS, plain code from numba and torch
NARROW := NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR" OPENBLAS_CORETYPE=Nehalem \
	ATEN_CPU_CAPABILITY=default NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=$(CURDIR)/_build/numba-narrow

.PHONY: book test check lab outputs clean install lock lint unit html pages notebooks mutation

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

test: $(STAMP) lint unit
	@.ci/browser
	@mkdir -p _build
	@$(MAKE) --no-print-directory notebooks >_build/notebooks.log 2>&1 & notebooks=$$!; \
	status=0; $(MAKE) --no-print-directory html pages || status=1; \
	wait $$notebooks || status=1; \
	cat _build/notebooks.log; \
	if test $$status = 0; then echo "All checks passed."; else echo "Some checks failed: see above."; fi; exit $$status

check: $(STAMP) lint unit

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

unit: $(STAMP)
	@$(BIN)/pytest -n 2 -m "not pages and not built"

pages: $(STAMP)
	@$(BIN)/pytest -n 2 -m "pages or built"

notebooks: $(STAMP)
ifneq ($(NOTEBOOKS),)
	@echo "Notebooks against their stored outputs, 1 thread"
	@$(THREADS_1) $(NBVAL) $(NOTEBOOKS) $(EXERCISES)
	@echo "Notebooks against their stored outputs, 2 threads"
	@$(THREADS_2) $(NBVAL) $(NOTEBOOKS)
	@echo "Notebooks against their stored outputs, wide vector units disabled"
	@$(THREADS_1) $(NARROW) $(NBVAL) $(NOTEBOOKS)
endif

lab: $(STAMP)
	@$(BIN)/jupyter lab book

outputs: $(STAMP)
	@$(BIN)/python book/_ext/outputs.py $(NOTEBOOKS)

# break every line on purpose: a test must fail (about an hour, resumable)
mutation: $(STAMP)
	@$(BIN)/python tests/mutation.py

clean:
	rm -rf _build .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
