# Everything runs in .venv, which is made on first use. PYTHON may name the interpreter to make it with.

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
PY := $(VENV)/bin/python
PIP := $(PY) -m pip install --quiet --disable-pip-version-check

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow nightly release-check drawn fuzz coverage mutants compat lint golden bench docs clean

help:            ## this list
	@sed -n 's/^\([a-z-]*\): .*## \(.*\)/  make \1\t\2/p; s/^\(help\): *## \(.*\)/  make \1\t\2/p' Makefile

demo: $(VENV)/demo.stamp     ## runs the examples: scripts, the SQL they become, their rows
	$(PY) examples/demo.py

# The tests of a file stay in one process: they share simulators and connections.
PYTEST := $(PY) -m pytest -n 2 --dist loadfile --durations 10

test: $(VENV)/dev.stamp      ## runs the tests of every feature, those of the examples and the documentation included
	$(PYTEST) -p no:randomly -m "not slow"

# In random order, so that no test leans on another.
test-slow: $(VENV)/dev.stamp ## runs the tests that take long, and 1,000 random programs of each kind
	SS2SQL_PROGRAMS=$${SS2SQL_PROGRAMS:-1000} $(PYTEST) --timeout 3600 -m "slow or drawn"

nightly: export SS2SQL_PROGRAMS = 20000
release-check: export SS2SQL_PROGRAMS = 100000
nightly release-check: export SS2SQL_WORLD_QUERIES = 5000
nightly release-check: export SS2SQL_SCENES = 200
nightly: drawn fuzz          ## the random tests, many more of them: 20,000 programs, 5,000 queries of each world; then fuzz
release-check: drawn         ## the same before a release: 100,000 programs, by another seed if SS2SQL_SEED is set

drawn: $(VENV)/dev.stamp
	$(PYTEST) --timeout 0 -m drawn

fuzz: $(VENV)/fuzz.stamp     ## texts that try to break parser and compiler; 20 minutes, or SS2SQL_FUZZ_SECONDS
	$(PY) tests/fuzz.py

# Tests that draw their programs by chance are left out: what they reach, others have to reach every time.
STAGES := --include='ss2sql/frontend/*,ss2sql/lowering/*'
coverage: $(VENV)/dev.stamp  ## which lines and branches no test reaches; fails below 95 %, below 100 % of frontend and lowering
	$(PYTEST) --timeout 600 --cov --cov-report= -m "not slow and not drawn"
	@echo "== reached by make test"
	$(PY) -m coverage report $(STAGES)
	$(PY) -m coverage report | tail -n 1
	$(PYTEST) --timeout 3600 --cov --cov-append --cov-report= -m "slow and not drawn"
	@echo "== reached by make test and make test-slow"
	$(PY) -m coverage report $(STAGES) --fail-under=100
	$(PY) -m coverage report --fail-under=95

mutants: $(VENV)/dev.stamp   ## small changes of the lowering and the resolver that no test sees; fails above 5 in 100
	$(PY) tests/mutants.py

compat: $(VENV)/compat.stamp ## the oldest and the newest packages that are allowed, under every Python that is here
	$(PY) tests/compat.py

lint: $(VENV)/dev.stamp      ## ruff and mypy
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

golden: $(VENV)/dev.stamp    ## writes the expectations of tests/cases and the outputs shown on pages anew
	$(PY) -m pytest tests/test_cases.py --golden -k test_case
	$(PY) docs/generate.py
	$(PY) tests/pages.py --write

bench: $(VENV)/bench.stamp   ## measures beside Python, SQL and graph libraries; a table, out/bench.json and out/bench.png
	$(PY) benchmarks/run.py
	$(PY) benchmarks/compare.py

docs: $(VENV)/docs.stamp     ## builds the documentation in docs/_build; a warning is an error
	$(PY) -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "open docs/_build/html/index.html"

clean:           ## removes what make has made
	rm -rf $(VENV) docs/_build out dist build htmlcov .coverage .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# --- the environment: a stamp is older than pyproject.toml when the installation is out of date ---------
# What development needs are dependency groups, which pip installs from 25.1 on.

$(VENV)/package.stamp: pyproject.toml
	@test -n "$(PYTHON)" || { echo "ss2sql needs Python 3.11 or newer; name it with: make PYTHON=..."; exit 1; }
	test -x $(PY) || $(PYTHON) -m venv $(VENV)
	$(PIP) "pip>=25.1"
	$(PIP) --editable .
	@touch $@

# PyBullet is made for some Pythons only, and takes long to compile: the demo does without it where need be.
$(VENV)/demo.stamp: $(VENV)/package.stamp
	$(PIP) --only-binary pybullet --editable ".[sim]" \
		|| echo "PyBullet cannot be installed here; the demo does without a simulator"
	@touch $@

$(VENV)/dev.stamp: $(VENV)/package.stamp
	$(PIP) --group dev
	@touch $@

$(VENV)/fuzz.stamp: $(VENV)/dev.stamp
	$(PIP) --group fuzz
	@touch $@

$(VENV)/compat.stamp: $(VENV)/package.stamp
	$(PIP) uv
	@touch $@

$(VENV)/bench.stamp: $(VENV)/package.stamp
	$(PIP) --group bench
	@touch $@

$(VENV)/docs.stamp: $(VENV)/package.stamp
	$(PIP) --group docs
	@touch $@
