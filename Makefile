# The whole line: simulation -> Cinema catalog -> surrogate -> report.  `make help` lists what there is.
SCENE   ?= tgv
PYTHON  ?= python3
# The folder of real data that scenes name.
export GS_SURROGATE_DATA ?= ../shared/data
RUNS    ?= runs
RECORDS ?= $(if $(filter runs,$(RUNS)),research/records,$(RUNS))
WORKERS ?=
SEEDS   ?= 3
MINUTES ?= 5
COMPARED_SEEDS ?= 1
SCENES  ?= $(filter $(basename $(notdir $(wildcard scenes/*.toml))),$(patsubst $(RUNS)/%/dataset.json,%,$(wildcard $(RUNS)/*/dataset.json)))
BIN     := .venv/bin
STUDY   := $(BIN)/python -m research.studies
SETUP   := .venv/.complete
# Without bytecode, which took 80 of 197 s: Python writes that of what is imported.
PIP     := -m pip install --no-compile --quiet --disable-pip-version-check
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(wildcard native/kernels/src/*)
# The example whose script scene SCENE runs, if it is hooked: somebody else's code, in an environment of its own.
EXAMPLE := $(shell sed -n 's|^script = "../examples/\([^/"]*\)/.*|\1|p' scenes/$(SCENE).toml 2>/dev/null)
HOOKED  := $(if $(EXAMPLE),.venv-$(EXAMPLE)/.complete)

.PHONY: help setup dataset train evaluate repeat results ablate ablate-visualization compare browse test test-fast test-research lint docs packages clients examples bench explore clean-scene

help:
	@echo "make dataset train [SCENE=$(SCENE)]   simulate, render, train, evaluate -> $(RUNS)/<scene>/report/"
	@echo "make results [SCENES=\"a b\"]         $(SEEDS) seeds, upper bound and report of each scene that has a data set -> docs/results/results.md"
	@echo "make repeat [SCENE=$(SCENE)]          $(SEEDS) seeds of one scene: mean and deviation -> $(RECORDS)/<scene>/seeds/"
	@echo "make ablate [SCENE=$(SCENE)]          what each choice of training is worth: hours -> $(RUNS), $(RECORDS)/<scene>/ablation/"
	@echo "make compare [SCENE=$(SCENE)]         published systems and ours, $(MINUTES) minutes each -> docs/results/comparison.md"
	@echo "make test | test-research        every test of the product (make test-fast: the quick ones), or of research/"
	@echo "make browse | explore [SCENE=$(SCENE)]   its pictures, or its surrogate, in a browser"
	@echo "make examples                    environments of the simulation codes of examples/: minutes"
	@echo "make docs                        the documentation's site -> build/site"
	@echo "make packages                    sdist and wheel, tried in empty environments: a minute for each Python"
	@echo "make setup | dataset | train | evaluate | browse | lint | bench, one by one"
	@echo "scenes: $(basename $(notdir $(wildcard scenes/*.toml)))"

setup: $(SETUP)

$(SETUP): $(SOURCES)
	@$(PYTHON) .ci/check_system.py
	$(PYTHON) -m venv .venv
	$(BIN)/python $(PIP) -c constraints.txt $(shell sed -n 's/^torch==/torch==/p' constraints.txt)
	$(BIN)/python $(PIP) -c constraints.txt -e '.[test,docs]'
	@touch $@

dataset: $(SETUP) $(HOOKED)
	$(if $(EXAMPLE),.venv-$(EXAMPLE)/bin,$(BIN))/insitu dataset scenes/$(SCENE).toml --runs $(RUNS) $(if $(WORKERS),--workers $(WORKERS))

# Training implies its data and its report; each step does nothing when nothing changed.
train: dataset
	$(BIN)/surrogate train scenes/$(SCENE).toml --runs $(RUNS)
	$(BIN)/surrogate evaluate scenes/$(SCENE).toml --runs $(RUNS)

# The same, and what the same Gaussians could reach for one member alone: it takes as long as training again.
evaluate: dataset
	$(BIN)/surrogate train scenes/$(SCENE).toml --runs $(RUNS)
	$(STUDY) ceiling scenes/$(SCENE).toml --runs $(RUNS) --records $(RUNS)
	$(BIN)/surrogate evaluate scenes/$(SCENE).toml --runs $(RUNS)

# The same training with other seeds; what is finished, or known from a record of the same settings and code, is not trained again.
repeat: dataset
	$(STUDY) repeat scenes/$(SCENE).toml --runs $(RUNS) --records $(RECORDS) --seeds $(SEEDS)

# Hours where little is there yet; interrupted, it goes on.  A scene that fails leaves the others, and one may have no upper bound.
results: $(SETUP)
	@failed=; for scene in $(SCENES); do \
	    { $(MAKE) --no-print-directory dataset SCENE=$$scene && \
	        $(STUDY) repeat scenes/$$scene.toml --runs $(RUNS) --records $(RECORDS) --seeds $(SEEDS) && \
	        { $(STUDY) ceiling scenes/$$scene.toml --runs $(RUNS) --records $(RECORDS) || true; } && \
	        $(BIN)/surrogate evaluate scenes/$$scene.toml --runs $(RUNS) --records $(RECORDS); } || failed="$$failed $$scene"; \
	done; $(BIN)/python -m research.benchmarks.results --runs $(RUNS) --records $(RECORDS) || failed="$$failed page"; \
	test -z "$$failed" || { echo "failed:$$failed"; exit 1; }

# Nine trainings for each seed, eight of them of so many minutes, and their scoring; interrupted, it goes on, and processes share it out.
compare: dataset
	$(STUDY) compare scenes/$(SCENE).toml --runs $(RUNS) --records $(RECORDS) --minutes $(MINUTES) --seeds $(COMPARED_SEEDS)
	$(BIN)/python -m research.benchmarks.results.comparison --records $(RECORDS)

# About five hours on two cores; an interrupted study goes on with what is missing, and processes share it out:
# `taskset -c 0 make ablate`, `taskset -c 1 make ablate`, ...
ablate: dataset
	$(STUDY) ablate scenes/$(SCENE).toml --runs $(RUNS) --records $(RECORDS)

# The designs of F_vis, trained on the same finished surrogate.
ablate-visualization: dataset
	$(BIN)/surrogate train scenes/$(SCENE).toml --runs $(RUNS)
	$(STUDY) ablate scenes/$(SCENE).toml --visualization --runs $(RUNS) --records $(RECORDS)

browse: dataset
	$(BIN)/catalogs browse $(RUNS)/$(SCENE)/catalog.cdb

explore: dataset
	$(BIN)/surrogate train scenes/$(SCENE).toml --runs $(RUNS)
	$(BIN)/surrogate explore $(RUNS)/$(SCENE)

# What conflicts with us lives alone, or takes long to build.  The Cinema clients conflict with each other as well; an example's
# environment has its simulation code beside our half that renders.  Without either their tests skip.
CLIENTS  := .venv-pycinema/.complete .venv-cinemasci/.complete
EXAMPLES := $(patsubst examples/%/requirements.txt,.venv-%/.complete,$(wildcard examples/*/requirements.txt))
clients: $(CLIENTS)
examples: $(EXAMPLES)
.venv-%/.complete: tests/clients/%.txt
	$(call environment,--no-deps -r $<)
.venv-%/.complete: examples/%/requirements.txt
	@for tool in $$(sed -n 's/^# system: //p' $<); do command -v $${tool%=*} >/dev/null || { \
	    echo "Missing: $${tool%=*}, which examples/$* is built with.  On Debian or Ubuntu: sudo apt-get install $${tool#*=}" >&2; \
	    exit 1; }; done
	$(call environment,-r $< -e '.[insitu]',$(wildcard examples/$*/build))

define environment
$(PYTHON) -m venv --clear .venv-$*
.venv-$*/bin/python $(PIP) $(1)
$(if $(2),$(2) .venv-$*)
@touch $@
endef

# The documentation's site, in build/site, without the network; a warning is an error, a link that leads nowhere among them.
# Examples that did not change are not run again; `make docs GALLERY=0` runs none.
docs: $(SETUP)
	OMP_NUM_THREADS=1 $(BIN)/sphinx-build -q -n -W --keep-going -b html $(if $(filter 0,$(GALLERY)),-D plot_gallery=0) docs build/site

# The sdist, and the wheel of each Python, each alone in an empty environment: `make packages PYTHONS="python3.11 python3.12"`.
packages:
	$(PYTHON) .ci/check_packages.py $(PYTHONS)

lint: $(SETUP)
	$(BIN)/ruff check . && $(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Four processes, also on two cores, since some tests wait; each with one thread, and with bytecode kept for the commands that tests
# start.  The tests of a file stay together, for they share what they trained or rendered; files that take long come first
# (tests/conftest.py).  Their folders are in memory where that has room: the tests write 100,000 files.
PROCESSES := $(shell cores=$$(nproc 2>/dev/null || echo 1); [ $$cores -lt 2 ] && echo 2 || echo 4)
FOLDERS   := $(shell test "$$(df --output=avail /dev/shm 2>/dev/null | tail -n 1)" -gt 8000000 2>/dev/null && echo TMPDIR=/dev/shm)
PYTEST    := $(FOLDERS) OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n $(PROCESSES) --dist loadfile --no-loadscope-reorder

test-fast: $(SETUP)
	$(PYTEST) --ignore tests/research

test: $(SETUP)
	-@$(MAKE) --no-print-directory clients || echo "No Cinema clients could be installed: their tests will skip."
	$(PYTEST) -m "slow or not slow" --ignore tests/research

test-research: $(SETUP)
	$(PYTEST) -m "slow or not slow" tests/research

# Writes the tables and plots of docs/: under 25 minutes on two cores that have nothing else to do; one that fails leaves the others.
bench: $(SETUP)
	@failed=; for part in splatting rendering.accuracy simulation.taylor_green; do \
	    OMP_NUM_THREADS=1 LP_NUM_THREADS=0 $(BIN)/python -m research.benchmarks.$$part || failed="$$failed $$part"; \
	done; test -z "$$failed" || { echo "failed:$$failed"; exit 1; }

clean-scene:
	rm -rf $(RUNS)/$(SCENE)
