# Copyright (C) 2026 The dolfinx_joints developers
# SPDX-License-Identifier: LGPL-3.0-or-later

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c

# make test DOLFINX=0.11 and the like: any target with that DOLFINx.
DOLFINX ?=
RUN = ./with-dolfinx$(DOLFINX:%= --dolfinx %)
PYTHON = $(RUN) python3
# A rank that waits for one that has failed would wait for ever: tests and demos abort all ranks
# when an error hits only one, and timeout ends what hangs nevertheless.
MPI_SECONDS ?= 1800
MPIRUN = $(RUN) timeout --foreground --kill-after=30 $(MPI_SECONDS) mpirun
# As many tests at once as there are cores.
PYTEST = $(PYTHON) -m pytest -q -n auto --dist worksteal
MPI_PYTEST = python3 -m pytest -q -x --color=no -p no:cacheprovider -m "mpi and not slow"

DEMO_ARGS ?=
PAPER_ARGS ?=
STUDY_ARGS ?=
CASES ?=
MUTANTS ?= 320
MUTANTS_SEED ?= 1992
BENCHMARKS = $(sort $(wildcard benchmarks/*.py))
BENCH_ARGS ?= --quick
DEMOS = $(basename $(notdir $(sort $(wildcard demos/[0-9]*.py))))
CODE = $(shell find dolfinx_joints geometry studies -name '*.py')

# Tools that are not Debian packages, or not in one version everywhere, come from PyPI into the
# user's cache; running the package needs none of them. mypy comes with Debian's packages, and the
# same way as the others where DOLFINx came from elsewhere. A change of requirements is one of the
# folder's name too.
TOOLS = $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/dolfinx_joints/tools
RUFF_TOOL := ruff-0.17
RUFF_NEEDS := 'ruff==0.17.*'
MYPY_TOOL := mypy-1.15
MYPY_NEEDS := 'mypy==1.15.*'
IMPORTS_TOOL := import-linter-2.16
IMPORTS_NEEDS := 'import-linter==2.16'
BUILD_TOOL := build-1.6
BUILD_NEEDS := 'build==1.6.*' 'setuptools==80.*'
SBOM_TOOL := cyclonedx-7
SBOM_NEEDS := 'cyclonedx-bom==7.*'
COVERAGE_TOOL := coverage-7$(DOLFINX:%=-with-%)
COVERAGE_NEEDS := 'coverage==7.*'
SITE_TOOL := site-2
SITE_NEEDS := 'sphinx==8.2.*' 'myst-parser==4.0.*' 'furo==2025.12.*' 'sphinx-mathjax-offline==0.0.2' \
	'jupytext==1.19.*' 'nbclient==0.11.*' 'ipykernel==7.*'
PEERS_TOOL := peers-1
PEERS_NEEDS := 'openseespy==3.8.*'
MUTANTS_TOOL := mutants-2
MUTANTS_NEEDS := 'cosmic-ray==8.7.*' 'coverage==7.*'
RUFF = $(RUN) "$(TOOLS)/$(RUFF_TOOL)/bin/ruff"
MYPY = $(RUN) env PYTHONPATH="$(CURDIR):$(TOOLS)/$(MYPY_TOOL)" python3 -m mypy \
	--cache-dir "$(TOOLS)/mypy-cache"
IMPORTS = $(RUN) env PYTHONPATH="$(CURDIR):$(TOOLS)/$(IMPORTS_TOOL)" \
	python3 "$(TOOLS)/$(IMPORTS_TOOL)/bin/lint-imports" --no-cache
BASH_SCRIPTS := with-dolfinx .ci/run tests/clean_root.sh tests/install_paths.sh

# $(call install_tool,FOLDER,REQUIREMENTS): into a new directory, then one rename, so that an
# interrupted call leaves nothing that is taken for whole.
define install_tool
[ -d "$(TOOLS)/$(1)" ] || { \
	mkdir -p "$(TOOLS)"; new=$$(mktemp -d "$(TOOLS)/new-XXXXXX"); \
	trap 'rm -rf "$$new"' EXIT; \
	echo "installing $(2) from PyPI in $(TOOLS)"; \
	$(PYTHON) -m pip install -q --disable-pip-version-check --root-user-action=ignore \
		--no-warn-script-location --no-warn-conflicts --target "$$new/whole" $(2); \
	mv -T "$$new/whole" "$(TOOLS)/$(1)" || [ -d "$(TOOLS)/$(1)" ]; }
endef

# $(call with_tool,FOLDER): $(PYTHON) that also finds the packages of a tool.
with_tool = PYTHONPATH="$(TOOLS)/$(1)$${PYTHONPATH:+:$$PYTHONPATH}" $(PYTHON)

.PHONY: help demo paper studies validate test test-2 test-3 test-rounding test-0.11 verify coverage mutants bench bench-peers lint doctest dist docs clean
.DEFAULT_GOAL := help

help: ## Show this list
	@echo 'Each target sets up what it needs by itself; the first may take minutes for that.'
	@awk -F ':.*## ' '/^[a-z0-9.-]+:.*## / {printf "  make %-13s %s\n", $$1, $$2}' Makefile

demo: ## Run the demos in turn; DEMO_ARGS="..." passes options to that of the dam
	$(PYTHON) demos/01_impact.py
	$(PYTHON) demos/02_sliding_block.py
	$(PYTHON) demos/03_ambiesta.py $(DEMO_ARGS)
	$(PYTHON) demos/04_gravity_dam.py
	$(PYTHON) demos/05_joint_law_in_ufl.py
	$(PYTHON) demos/06_how_it_works.py
	$(PYTHON) demos/07_arch_dam_study.py
	$(PYTHON) demos/08_results.py
	$(PYTHON) demos/09_own_newton.py

paper: ## The 1992 paper's runs, figures and report; PAPER_ARGS="--record DIRECTORY"
	$(PYTHON) -m studies.paper $(PAPER_ARGS)

studies: ## What the paper leaves open, errors of mesh and step, gravity dams; STUDY_ARGS="--records DIRECTORY"
	$(PYTHON) -m studies.follow_ups $(STUDY_ARGS)
	$(PYTHON) -m studies.convergence $(subst --records,--record,$(STUDY_ARGS))
	$(PYTHON) -m studies.thermal_opening $(subst --records,--record,$(STUDY_ARGS))
	$(PYTHON) -m studies.dam_on_wedge $(subst --records,--record,$(STUDY_ARGS))
	$(PYTHON) -m studies.gravity_dams

validate: ## The atlas of validation: numbers of others beside ours, a page each; CASES="..." of it
	@$(call install_tool,$(PEERS_TOOL),$(PEERS_NEEDS))
	$(call with_tool,$(PEERS_TOOL)) -m validation $(CASES)

# Left to test-2: what puts the parts together that the other tests look at one by one.
WHOLE = tests/verification tests/studies tests/test_benchmarks.py
test: ## Run the tests but the slow ones on 1 rank; those of the parts also on 2
	$(PYTEST) -m "not slow" tests
	$(MPIRUN) -n 2 $(MPI_PYTEST) tests $(WHOLE:%=--ignore=%)

test-2: ## Run verification, studies and benchmarks of any rank count on 2 ranks
	$(MPIRUN) -n 2 $(MPI_PYTEST) $(WHOLE)

# In two processes: in one, Open MPI was seen to wait for ever near the end.
test-3: ## Run the tests of any rank count on 3 ranks
	$(MPIRUN) -n 3 $(MPI_PYTEST) tests $(WHOLE:%=--ignore=%)
	$(MPIRUN) -n 3 $(MPI_PYTEST) $(WHOLE)

# Loops without AVX and FMA, and another kernel of OpenBLAS than any processor since 2011 takes: last
# bits of sums and products differ from those of `test`, and results may by rounding only. numba
# keeps the machine code of each processor.
test-rounding: export NUMBA_CPU_NAME := generic
test-rounding: export OPENBLAS_CORETYPE := Prescott
test-rounding: test-3 ## Run test-3 with the machine code of an old processor, which rounds otherwise

test-0.11: DOLFINX := 0.11
test-0.11: ## Run the tests but the slow ones on 1 rank with DOLFINx 0.11 of Debian unstable
	$(PYTEST) -m "not slow" tests

verify: test-2 test-3 ## Run test-2, test-3, the slow tests, a part on 4 ranks, demos on 2
	$(PYTEST) -m slow tests
	$(MPIRUN) -n 4 python3 -m pytest -q -x --color=no -p no:cacheprovider -m mpi \
		tests/verification/test_objectivity.py tests/verification/test_many_ranks.py
	$(MPIRUN) -n 2 python3 demos/01_impact.py
	$(MPIRUN) -n 2 python3 demos/02_sliding_block.py
	$(MPIRUN) -n 2 python3 demos/03_ambiesta.py --steps 50
	$(MPIRUN) -n 2 python3 demos/04_gravity_dam.py
	$(MPIRUN) -n 2 python3 demos/05_joint_law_in_ufl.py
	$(MPIRUN) -n 2 python3 demos/07_arch_dam_study.py --steps 20
	$(MPIRUN) -n 2 python3 demos/09_own_newton.py

# Measured are the processes that the tests start, too: Python imports sitecustomize as it starts.
# Compiled kernels are seen where tests have the interpreter run them. Settings: pyproject.toml.
COVERED = env COVERAGE_PROCESS_START="$(CURDIR)/pyproject.toml" \
	COVERAGE_FILE="$(CURDIR)/build/coverage/data" \
	PYTHONPATH="$(CURDIR)/build/coverage:$(TOOLS)/$(COVERAGE_TOOL)$${PYTHONPATH:+:$$PYTHONPATH}"
coverage: ## Lines and branches of the package that the tests but the slow ones run, on 1 and 2 ranks
	@$(call install_tool,$(COVERAGE_TOOL),$(COVERAGE_NEEDS))
	rm -rf build/coverage
	mkdir -p build/coverage
	echo 'import coverage; coverage.process_startup()' >build/coverage/sitecustomize.py
	$(COVERED) $(PYTEST) -m "not slow" tests
	$(COVERED) $(MPIRUN) -n 2 $(MPI_PYTEST) tests
	$(call with_tool,$(COVERAGE_TOOL)) -m coverage combine -q build/coverage
	$(call with_tool,$(COVERAGE_TOOL)) -m coverage report --fail-under=95

# In a copy of the last commit, whose tests are watched first. Settings: tests/mutants.toml.
MUTANTS_TESTS = $(addprefix tests/,laws joints time_integration solvers simulation \
	model/test_model.py model/test_mass_redistribution.py \
	$(patsubst %,verification/test_%.py,law_paths sliding_block bouncing_bar bar_on_wall \
	plasticity loose_blocks shaking_base))
IN_COPY = cd build/mutants && \
	PYTHONPATH="tests:$(TOOLS)/$(MUTANTS_TOOL)$${PYTHONPATH:+:$$PYTHONPATH}" $(PYTHON)
COSMIC_RAY = $(IN_COPY) -m cosmic_ray.cli
mutants: ## Do tests notice small faults in laws, joints, schemes, solvers? MUTANTS=320 of them
	@$(call install_tool,$(MUTANTS_TOOL),$(MUTANTS_NEEDS))
	rm -rf build/mutants
	git clone -q --shared . build/mutants
	mkdir -p build/mutants/build/original
	cp -rL build/mutants/dolfinx_joints build/mutants/build/original
	-$(IN_COPY) -m coverage run --source=dolfinx_joints -m pytest -q -p mutants \
		-p no:cacheprovider -m "not slow" $(MUTANTS_TESTS)
	$(COSMIC_RAY) init tests/mutants.toml build/session
	$(IN_COPY) -m cosmic_ray.tools.filters.operators_filter build/session tests/mutants.toml
	$(IN_COPY) tests/mutants.py sample build/session $(MUTANTS) $(MUTANTS_SEED)
	$(COSMIC_RAY) baseline tests/mutants.toml
	$(COSMIC_RAY) exec tests/mutants.toml build/session
	$(IN_COPY) -m cosmic_ray.tools.report --surviving-only --show-diff build/session
	$(IN_COPY) -m cosmic_ray.tools.survival_rate build/session

bench: ## Run a part of the benchmarks that have --quick; all of each with BENCH_ARGS=
	@for script in $(BENCHMARKS); do \
		case "$(BENCH_ARGS)" in *--quick*) grep -q '"--quick"' "$$script" || continue;; esac; \
		echo "== $$script"; $(PYTHON) "$$script" $(BENCH_ARGS); done

bench-peers: ## The jointed wall also in OpenSees: motion and time per step side by side
	@$(call install_tool,$(PEERS_TOOL),$(PEERS_NEEDS))
	$(call with_tool,$(PEERS_TOOL)) -m benchmarks.opensees_wall

lint: ## Check style, imports between wings, and types
	@$(call install_tool,$(RUFF_TOOL),$(RUFF_NEEDS))
	@$(call install_tool,$(IMPORTS_TOOL),$(IMPORTS_NEEDS))
	@$(PYTHON) -c 'import mypy' 2>/dev/null || $(call install_tool,$(MYPY_TOOL),$(MYPY_NEEDS))
	$(RUFF) check .
	$(RUFF) format --check .
	$(IMPORTS)
	$(MYPY) dolfinx_joints
	@if command -v shellcheck >/dev/null; then echo shellcheck; shellcheck -x $(BASH_SCRIPTS); fi

# Each example in an empty folder of its own; geometry, a link to a folder above, has none.
EXAMPLES = $(sort $(shell grep -rl --include='*.py' '>>> ' dolfinx_joints))
doctest: ## Run the examples in the docstrings
	@PYTHONPATH="tests$${PYTHONPATH:+:$$PYTHONPATH}" $(PYTHON) -m pytest -q -p doctest_folders \
		-p no:cacheprovider --doctest-modules $(EXAMPLES)

dist: ## Build source distribution and wheel in dist/ with a bill of materials, and try them
	@$(call install_tool,$(BUILD_TOOL),$(BUILD_NEEDS))
	@$(call install_tool,$(SBOM_TOOL),$(SBOM_NEEDS))
	rm -rf dist build/sbom *.egg-info
	$(call with_tool,$(BUILD_TOOL)) -m build -q --no-isolation
	rm -rf *.egg-info
	DOLFINX_JOINTS_DIST="$(CURDIR)/dist" $(PYTHON) -m pytest -q tests/test_packaging.py
	$(RUN) env -u PYTHONPATH python3 -m venv --without-pip build/sbom/venv
	$(RUN) env -u PYTHONPATH python3 -m pip -q --python build/sbom/venv/bin/python install \
		--root-user-action=ignore dist/*.whl
	printf '#!/bin/sh\nexec env -u PYTHONPATH build/sbom/venv/bin/python "$$@"\n' >build/sbom/python
	chmod +x build/sbom/python
	$(call with_tool,$(SBOM_TOOL)) -m cyclonedx_py environment --output-reproducible \
		--pyproject pyproject.toml -o build/sbom/dolfinx_joints.cdx.json build/sbom/python

build/demos/%/printed.txt: demos/%.py $(CODE)
	mkdir -p $(@D)
	cd $(@D) && "$(CURDIR)/$(RUN)" python3 "$(CURDIR)/$<" >new.txt
	mv $(@D)/new.txt $@

docs: $(DEMOS:%=build/demos/%/printed.txt) ## Build the documentation site in build/site; runs the demos for it
	@$(call install_tool,$(SITE_TOOL),$(SITE_NEEDS))
	$(call with_tool,$(SITE_TOOL)) docs/site/build.py --runs build/demos --out build/site
	DOLFINX_JOINTS_SITE="$(CURDIR)/build/site" $(PYTHON) -m pytest -q tests/test_site.py

clean: ## Remove what the other targets left in this folder
	rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
