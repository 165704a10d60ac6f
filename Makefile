# mapod: `make run` and `make test` each set up what is missing, by themselves.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
SECONDS ?=
SEED ?= 1
SCENE ?= corridor

.PHONY: help setup run rig planner test test-all test-waiting test-working lock audit sbom flash-proof nightly coverage decisions mutants check format bench campaign faults realtime flash conformance soak mcu c-sanitize experiments terrain placement sensitivity pictures objects object-map coverage-plans link-soak \
  fuzz clean
help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

unexport PYTHONDONTWRITEBYTECODE # pip compiles nothing: what is imported compiles once, the rest never

$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || { echo "mapod: needs $(PYTHON): apt install python3.11 python3.11-venv"; exit 1; }
	@echo "mapod: setting up the virtual environment in $(VENV) (once)"
	@$(PYTHON) -m venv $(VENV) || { echo "mapod: needs venv: apt install python3.11-venv"; exit 1; }

EXTRAS_sim := sim objects view
EXTRAS_test := camera objects drawings view export foxglove sweep video test

$(VENV)/.ready-%: pyproject.toml requirements.lock tools/deps/lock.py | $(BIN)/python
	@echo "mapod: installing the libraries that requirements.lock has for [$(or $(EXTRAS_$*),$*)]"
	@$(BIN)/python -m tools.deps.lock $(or $(EXTRAS_$*),$*) > $(VENV)/$*.txt
	@$(BIN)/python -m pip install --disable-pip-version-check --progress-bar off --no-compile --no-deps --require-hashes \
	  --requirement $(VENV)/$*.txt
	@touch $@

$(VENV)/.warm: $(VENV)/.ready-sim $(wildcard *.py) $(shell find core hw fakes -name "*.py")
	@echo "mapod: compiling the kernels that changed, of the app and of the simulated world (all: half a minute)"
	@$(BIN)/python -m tools.warm
	@touch $@

# the command in a checkout, from whatever folder
$(BIN)/mapod: Makefile | $(BIN)/python
	@printf '#!/bin/sh\nPYTHONPATH="%s" exec "%s/python" -P -m mapod "$$@"\n' "$(CURDIR)" "$(CURDIR)/$(BIN)" > $@
	@chmod +x $@

setup: $(VENV)/.warm $(BIN)/mapod ## virtual environment in .venv, libraries, compiled kernels

run: setup ## simulated robot, the app, and a live picture of the map [SECONDS=20 SEED=1]
	@$(BIN)/python -m mapod demo --scene $(SCENE) --seed $(SEED) $(if $(SECONDS),--seconds $(SECONDS))

rig: setup ## the app as it is, in real time, as rig.toml says: real or fake devices, a planner in C on an emulated MCU [SCENE=aisle SEED=1 SECONDS=60]
	@$(BIN)/python -m tools.rig.live $(if $(filter command line,$(origin SCENE)),--scene $(SCENE)) \
	  $(if $(filter command line,$(origin SEED)),--seed $(SEED)) $(if $(SECONDS),--seconds $(SECONDS)) $(ARGS)

planner: setup ## the demonstration planner in C on a Cortex-M3: its flash, RAM and stack
	@$(BIN)/python -m tools.rig.c_sizes planner

campaign: setup ## simulated drives to goals through random scenes [N=200 SEED=1 FAULTS=1 ONLY=17 WATCH=1 RECORD=folder RESUME=folder MISSES=folder]
	@$(BIN)/python -m tools.rig.campaign --runs $(or $(N),200) --seed $(SEED) \
	  $(if $(JOBS),--jobs $(JOBS)) $(if $(ONLY),--only $(ONLY)) $(if $(FAULTS),--faults $(FAULTS)) \
	  $(if $(filter command line,$(origin SCENE)),--scene $(SCENE)) \
	  $(if $(WATCH),--watch) $(if $(RECORD),--record $(RECORD)) $(if $(RESUME),--resume $(RESUME)) $(if $(MISSES),--misses $(MISSES)) $(ARGS)

faults: setup ## every fault of every fake while the robot drives, and pairs of them [PAIRS=40 ONLY=scanner.]
	@$(BIN)/python -m tools.rig.fault_table --pairs $(or $(PAIRS),40) --seed $(SEED) $(if $(ONLY),--only $(ONLY))

realtime: setup ## how late ticks are, and how soon a scan is at the far end of the wire, with and without load [SECONDS=60]
	@$(BIN)/python -m tools.rig.latency $(if $(SECONDS),--seconds $(SECONDS)) $(ARGS)

# picture, target that drew it, the code that decides what it looks like
DRAWN = $(BIN)/python -c "from tools.docs.pictures import record; record(['$(1)'], 'make $(2)', ['$(3)'])"

# The drives of one file share what they look at, so a file stays in one process.
PYTEST := $(BIN)/python -m pytest
PARALLEL := -n auto --maxprocesses 8 --dist loadfile
SECOND_ROOT := tests/tools/flash/test_second_root.py # it waits more than it works
COUNTED := tests/tools/bench/test_process.py # wants both cores
YIELDING := nice -n 5 # to what runs in real time

c-sanitize: setup $(VENV)/.ready-test ## the C of the header and of the planner under the address and undefined behaviour sanitizers
	@MAPOD_C_SANITIZE=1 ASAN_OPTIONS=detect_leaks=0 LD_PRELOAD="$$(gcc -print-file-name=libasan.so)" \
	  $(PYTEST) $(PARALLEL) $(addprefix tests/hw/mcu/test_,rules.py vectors.py restarts.py objects.py) \
	  $(addprefix tests/fakes/planner_mcu/test_,doubts.py extremes.py rules.py views.py) \
	  $(addprefix tests/tools/conformance/test_,conformance.py soak.py)

$(VENV)/.ready-test: | $(VENV)/.ready-sim # one pip at a time; kernels compile beside the second

test: ## the tests, on all cores: none of them looks at the clock
	@$(MAKE) --no-print-directory -j2 setup $(VENV)/.ready-test
	@echo "mapod: running the tests, but not the slow ones and those in real time (make test-all)"
	@$(PYTEST) $(PARALLEL) -m "not slow and not real_time"

test-all: test $(VENV)/.ready-fuzz ## the tests, costs, then those in real time and the flash, and beside them the slow ones, mutants, sanitized C
	@echo "mapod: comparing costs, and what the process uses, with those kept last (make bench)"
	@$(BIN)/python -m tools.bench.ratios --check
	@$(PYTEST) -n 0 -m real_time $(COUNTED)
	@echo "mapod: running what waits (tests in real time, the flash on a second root) and, beside it, what works"
	@$(MAKE) --no-print-directory -j2 test-waiting test-working || \
	  { echo "mapod: make test-all failed: above, where 'failed' or 'Error' stands"; exit 1; }

# Nobody asks for these two: they make up the rest of test-all.
test-waiting: setup $(VENV)/.ready-test
	@$(PYTEST) -n 0 -m real_time --ignore=$(SECOND_ROOT) --ignore=$(COUNTED)
	@$(MAKE) --no-print-directory flash-proof

test-working: setup $(VENV)/.ready-test
	@echo "mapod: running the slow tests"
	@$(YIELDING) $(PYTEST) $(PARALLEL) --no-loadscope-reorder -m "slow and not real_time"
	@$(YIELDING) $(MAKE) --no-print-directory decisions
	@$(YIELDING) $(MAKE) --no-print-directory c-sanitize

flash-proof: setup $(VENV)/.ready-test ## flash, crash, hang, broken version, 20 power cuts, rollback: on a second root with systemd; needs root
	@$(PYTEST) -n 0 -s $(SECOND_ROOT)

nightly: setup $(VENV)/.ready-test ## the tests of properties, with many more examples, other ones each time
	@$(PYTEST) $(PARALLEL) --hypothesis-profile nightly -m "hypothesis and not real_time"

coverage: setup $(VENV)/.ready-test ## every branch of what says free or moves the robot, with kernels as Python: 100 % or it fails
	@$(BIN)/python -m tests.mutation.coverage

decisions: | coverage # both, one after the other
	@$(MAKE) --no-print-directory mutants

mutants: setup $(VENV)/.ready-test ## faults put into those files: their tests must see each [N=100: a sample, SEED=1; ONLY=path]
	@$(BIN)/python -m tests.mutation --count $(or $(N),0) --seed $(SEED) $(if $(ONLY),--only $(ONLY))

check: $(VENV)/.ready-sim $(VENV)/.ready-test $(VENV)/.ready-lint ## format, lint, strict types
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy

lock: | $(BIN)/python ## requirements.lock anew, from pyproject.toml: versions and hashes [UPGRADE=1: the newest], and sbom
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet --target build/uv "uv>=0.9,<1"
	@build/uv/bin/uv pip compile pyproject.toml --quiet --all-extras --generate-hashes --universal \
	  --python-version 3.11 --no-header $(if $(UPGRADE),--upgrade) --output-file requirements.lock
	@$(MAKE) --no-print-directory sbom

audit: | $(BIN)/python ## requirements.lock against a public list of known weaknesses; needs a network, so CI does not [SERVICE=osv]
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet --target build/audit "pip-audit>=2.9,<3" || \
	  { echo "mapod: pip-audit can't be fetched: is there a network?"; exit 2; }
	@$(BIN)/python -m tools.deps.audit --tool build/audit $(if $(SERVICE),--service $(SERVICE))

sbom: | $(BIN)/python ## docs/sbom.cdx.json from requirements.lock: all libraries, in the form CycloneDX
	@$(BIN)/python -m tools.deps.sbom

format: $(VENV)/.ready-lint ## put the code into form
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

flash: $(VENV)/.ready-sim ## put mapod onto a robot over ssh, with a way back: docs/flash.md [HOST=user@robot ARGS="--rollback"]
	@test -n "$(HOST)" || { echo "mapod: which robot? make flash HOST=user@robot"; exit 1; }
	@$(BIN)/python -m mapod flash $(HOST) $(ARGS)

bench: setup $(VENV)/.ready-test ## ratios to NumPy, OpenCV, OctoMap, Open3D and to itself, smaller; what the process uses, beside the figures kept last; what a scan, an image, the planner link and a depth frame cost [KEEP=1 keeps them]
	@test -d build/octomap || { rm -rf build/octomap.part; \
	  $(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --target build/octomap.part "pyoctomap>=1.2,<2" && \
	  mv build/octomap.part build/octomap; } || echo "mapod: without OctoMap beside it"
	@test -d build/open3d || { echo "mapod: fetching Open3D to measure against, 400 MB, once"; rm -rf build/open3d.part; \
	  $(BIN)/python -m pip install --disable-pip-version-check --quiet --target build/open3d.part "open3d>=0.19,<1" && \
	  mv build/open3d.part build/open3d; } || echo "mapod: without Open3D beside it"
	@$(BIN)/python -m tools.bench.ratios $(if $(KEEP),--keep)
	@$(if $(KEEP),$(call DRAWN,bench-ratios.png,bench,tools/bench/ratio_picture.py))
	@$(BIN)/python -m tools.bench.process $(if $(KEEP),--keep)
	@$(BIN)/python -m tools.bench.bench
	@$(BIN)/python -m tools.bench.mapping
	@$(BIN)/python -m tools.bench.stripe
	@$(BIN)/python -m tools.bench.link
	@$(BIN)/python -m tools.bench.objects

conformance: setup ## the conformance tests of the planner link, in process, against both receivers (C and Python)
	@$(BIN)/python -m tools.conformance

soak: setup ## simulated hours of driving with random faults in one process: memory, counters, clocks, every wrap [HOURS=24 SEED=1]
	@$(BIN)/python -m tools.rig.soak --hours $(or $(HOURS),24) --seed $(SEED)

link-soak: setup ## a million damaged, lost, doubled frames to both receivers of the planner link [FRAMES=1000000]
	@$(BIN)/python -m tools.conformance --soak $(or $(FRAMES),1000000) --seed $(SEED)

pictures: setup $(VENV)/.ready-view $(VENV)/.ready-test ## the documents' pictures of the live page: a simulated drive in a headless Chromium
	@$(BIN)/python -m tools.view.pictures

placement: setup ## docs/terrain.md's picture: what mounts of a downward-looking sensor see of rough ground
	@$(BIN)/python -m mapod placement --fields 200 --picture docs/pictures/placement.png
	@$(call DRAWN,placement.png,placement,tools/placement/*.py)

objects: setup $(VENV)/.ready-test ## docs/objects.md's pictures: what the steps make of real frames of a depth camera
	@$(BIN)/python -m tools.objects.pictures

coverage-plans: setup $(VENV)/.ready-test ## docs/coverage.md's table and picture: planners on floor plans of real robots; minutes
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet "coverage-path-planner>=1.4,<2"
	@$(BIN)/python -m tools.floorplans.table

sensitivity: setup ## docs/method.md's picture: each constant halved and doubled; hours, goes on where it stopped
	@$(BIN)/python -m tools.experiments.sensitivity --only 7 --kept sensitivity.json \
	  --picture docs/pictures/sensitivity.png
	@$(call DRAWN,sensitivity.png,sensitivity,tools/experiments/sensitivity.py)

object-map: setup $(VENV)/.ready-objects ## docs/object-map.md's table and picture: simulated rooms against their truth; ten minutes
	@$(BIN)/python -m tools.experiments.object_rooms --picture docs/pictures/object-map.png

experiments: setup ## the paper's experiments and more, both methods: docs/experiments.md, pictures [ONLY=5.3]
	@$(BIN)/python -m tools.experiments $(if $(ONLY),--only $(ONLY))

terrain: setup $(VENV)/.ready-camera ## docs/terrain.md's maps of centimetres, by each method: tables and pictures; ten minutes [ARGS=--quick]
	@$(BIN)/python -m tools.experiments.terrain $(ARGS)

fuzz: setup $(VENV)/.ready-test $(VENV)/.ready-fuzz ## all that takes bytes from outside: guided, then long inputs; then the C header [MINUTES=10 each; KEEP=1: count it, keep new inputs]
	@$(BIN)/python -m tools.fuzz --seconds $$(( 60 * $(or $(MINUTES),10) )) $(if $(KEEP),--count --keep)
	@$(BIN)/python -m tools.fuzz --streams --seconds $$(( 60 * $(or $(MINUTES),10) )) $(if $(KEEP),--count)
	@$(BIN)/python -m tests.support.link.c_fuzz --seconds $$(( 60 * $(or $(MINUTES),10) )) --seed $(SEED)

mcu: setup $(VENV)/.ready-test ## code, state and stack of hw/mcu/mapod_link.h on Cortex-M0, M3, M4
	@$(BIN)/python -m tools.rig.c_sizes header

clean: ## remove all that the other targets made
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis mapod.egg-info build
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
