# Needs Python 3.11+ with venv, a C++20 compiler and make; everything else comes into .venv.
#   make demo [BAG=my.bag]   see it work        make test    all tests
#   make check               style and types    make help    every target

PYTHON ?= python3
JOBS ?= $(shell nproc 2>/dev/null || echo 2)
FUZZ_SECONDS ?= 600
TORTURE_SECONDS ?= 600
KILL_SECONDS ?= 15
HISTORY_SECONDS ?= 60
FAULT_CYCLES ?= 1000
FAULT_SEED ?= 1
BAG ?=

VENV := .venv
STAMPS := .stamps
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -q
CMAKE := $(BIN)/cmake
export PATH := $(CURDIR)/$(BIN):$(PATH)

NATIVE := $(shell find core bindings measure tests -name '*.?pp' -not -name '*.*.?pp' -not -path '*/env/*' 2>/dev/null)
CPP := $(shell find core bindings measure tests -name '*.?pp' -not -path '*/env/*' 2>/dev/null)
# Address randomisation finer than GCC 12's ThreadSanitizer expects would stop it at start.
FIXED_ADDRESSES := $(shell command -v setarch >/dev/null 2>&1 && echo setarch $$(uname -m) -R)
# pip compiles the extension in this folder. The programs of C++ link the same core there.
TREE = $(wildcard build/$(shell $(BIN)/python -c 'import sys, sysconfig; \
    v = "cp%d%d" % sys.version_info[:2]; \
    print(v, v + ("t" if sysconfig.get_config_var("Py_GIL_DISABLED") else ""), sep="-")')-*)
# The naive model is slow under sanitizers, and has one thread: `make test` draws more.
ONE_SEED := TFDB_MODEL_SEEDS=1

.DELETE_ON_ERROR:
.PHONY: help demo test test-cpp test-python check measure bench-rooms tsan tsan-engines asan \
        asan-python fuzz torture histories faults relacy proof ros2 docs wheel wheels stubs format clean distclean

help:
	@echo 'make demo [BAG=file]  the main job on a recording, pictures in out/'
	@echo 'make test             C++ tests, interleaving walks, Python tests'
	@echo 'make check            formatting, lint, types, clang-tidy; every C++ program compiled'
	@echo 'make measure          tfdb against its rivals, the goals, the paper'"'"'s sweeps: the figures in docs/;'
	@echo '                      MEASURE=--quick in minutes, MEASURE="--only engines" for a part'
	@echo 'make tsan | asan      C++ tests under sanitizers'
	@echo 'make asan-python      the fuzzer of the public face, with the extension under a sanitizer'
	@echo 'make fuzz             fuzzers, FUZZ_SECONDS=$(FUZZ_SECONDS) each (clang)'
	@echo 'make torture          writers of a shared store are killed, its files damaged; TORTURE_SECONDS=$(TORTURE_SECONDS)'
	@echo 'make histories        processes share a store for HISTORY_SECONDS=$(HISTORY_SECONDS); what they did is judged'
	@echo 'make faults           homes and mirrors in network namespaces with faults, FAULT_CYCLES=$(FAULT_CYCLES),'
	@echo '                      FAULT_SEED=$(FAULT_SEED); root, 2 hours'
	@echo 'make proof            every interleaving walk to its end (15 minutes), relacy, histories, torture,'
	@echo '                      make check with clang-tidy on the tests as well, and its analyser'
	@echo 'make relacy           model checks of the protocol (package relacy-dev)'
	@echo 'make ros2             a real rclpy in .ros2, for the tests of live nodes of ROS 2'
	@echo 'make docs             site in build/docs: guides, API reference, search'
	@echo 'make wheel            sdist and wheel for this machine in dist/, checked'
	@echo 'make wheels           all packages of a release in dist/, checked (WHEELS="--only aarch64")'
	@echo 'make stubs | format   rewrite src/tfdb/_core.pyi | all sources'
	@echo 'make clean            remove what was built; distclean: .venv too'

# -- environment ----------------------------------------------------------------------------------

$(STAMPS)/venv:
	@mkdir -p $(STAMPS)
	$(PYTHON) -m venv $(VENV) || (echo 'no venv module: install your python3-venv package'; exit 1)
	$(PIP) install 'cmake>=3.21' 'ninja>=1.11' 'scikit-build-core>=0.10' 'nanobind>=3.1'
	@touch $@

# The editable install only recompiles what changed.
$(STAMPS)/install: $(STAMPS)/venv pyproject.toml CMakeLists.txt $(NATIVE)
	$(PIP) install --no-build-isolation -e '.[all]'
	@touch $@

$(STAMPS)/dev: pyproject.toml | $(STAMPS)/install
	$(PIP) install --no-build-isolation -e '.[dev]'
	@touch $@

# -- use ------------------------------------------------------------------------------------------

demo: $(STAMPS)/install
	$(BIN)/python examples/demo.py $(if $(BAG),'$(BAG)')

# -- proof ----------------------------------------------------------------------------------------

test: test-cpp test-python

test-cpp: $(STAMPS)/install
	$(CMAKE) -DTFDB_TESTS=ON $(TREE) >/dev/null
	$(CMAKE) --build $(TREE) -j $(JOBS)
	cd $(TREE) && ../../$(BIN)/ctest -E torture -j $(JOBS) --output-on-failure
	$(TREE)/bin/torture_store_shared --seconds $(KILL_SECONDS)
	$(TREE)/bin/torture_store_apply --seconds 3
	$(TREE)/bin/torture_store_damage --seconds 6

# Two processes more than cores: many tests wait for other processes.
test-python: $(STAMPS)/dev
	$(BIN)/python -m pytest -n $$(($(JOBS) + 2)) --dist loadfile --max-worker-restart 0 $(PYTEST)

# Every program there is; `make test` then finds them built. Warnings are errors if the environment of
# the installation had TFDB_WERROR=ON, as in CI.
# Every public name has a type that each checker takes for the same.
# clang-tidy is not on PyPI for every platform: without it the rest is still checked, except in CI.
# Tests and their kin, and the paths that its analyser walks, wait for `make proof`.
check: $(STAMPS)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	PYTHONPATH=src $(BIN)/basedpyright --verifytypes tfdb --ignoreexternal
	$(BIN)/clang-format --dry-run -Werror $(CPP)
	$(CMAKE) -DTFDB_TESTS=ON -DTFDB_BENCH=ON $(TREE) >/dev/null
	$(CMAKE) --build $(TREE) -j $(JOBS)
	$(BIN)/python tools/make_stubs.py --check
	$(BIN)/python -m pytest -q tests/architecture
	@if command -v clang-tidy >/dev/null; then $(BIN)/python tools/run_clang_tidy.py $(TIDY) $(TREE); \
	elif [ "$$CI" = true ]; then echo 'clang-tidy is missing'; exit 1; \
	else echo 'clang-tidy is missing: not run'; fi

# It does not see every call that locks a robust mutex, and then takes its unlocking for a mistake.
UNDER_TSAN := TSAN_OPTIONS='halt_on_error=1 report_mutex_bugs=0'
tsan: $(STAMPS)/venv
	$(CMAKE) --preset tsan >/dev/null
	$(CMAKE) --build --preset tsan -j $(JOBS) --target tfdb_tests
	$(UNDER_TSAN) $(ONE_SEED) $(FIXED_ADDRESSES) build/tsan/bin/tfdb_tests

# Tests of the store in each research engine. `make tsan` runs those of the engines themselves.
tsan-engines: tsan
	cd build/tsan && $(UNDER_TSAN) \
	    $(FIXED_ADDRESSES) ../../$(BIN)/ctest -R tfdb_tests_ -E 'portable|v3' --output-on-failure

asan: $(STAMPS)/venv
	$(CMAKE) --preset asan >/dev/null
	$(CMAKE) --build --preset asan -j $(JOBS) --target tfdb_tests
	UBSAN_OPTIONS=print_stacktrace=1 $(ONE_SEED) build/asan/bin/tfdb_tests

# The extension in a Python that looks at every access to memory, and the tests that press it most.
UNDER_ASAN := $(BIN)/python tools/run_under_asan.py build/asan-python
asan-python: $(STAMPS)/dev
	$(CMAKE) --preset asan-python -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python >/dev/null
	$(CMAKE) --build --preset asan-python -j $(JOBS) --target _core
	$(UNDER_ASAN) -m tests.hostile.fuzz --calls 40000
	$(UNDER_ASAN) -m tests.hostile.fuzz --calls 20000 --threads
	$(UNDER_ASAN) -m pytest -q --capture=sys -p no:cacheprovider tests/test_bad_*.py tests/test_batch.py \
	    tests/test_copies.py tests/test_objects.py tests/test_messages.py tests/wire/test_codec.py \
	    tests/wire/test_concurrent_changes.py tests/life/test_closing.py tests/tf2/test_messages_made.py

# What `make test` walks with one preemption where a walk is long is walked to its end here, and what
# `make check` leaves out is checked.
proof: TIDY := --all
proof: check relacy tsan-engines histories torture
	$(TREE)/bin/tfdb_sched --all
	TFDB_KILLS=200 $(BIN)/python -m pytest -q tests/recorder/test_killed.py
	TFDB_NET_WORLDS=1000 TFDB_NET_CYCLES=200 $(BIN)/python -m pytest -q tests/net

relacy: $(STAMPS)/venv
	$(CMAKE) --preset relacy >/dev/null
	$(CMAKE) --build --preset relacy -j $(JOBS) --target tfdb_relacy
	for model in build/relacy/bin/relacy_*; do echo "$$model"; $$model || exit 1; done

# By the clock, then also before a chosen store to shared memory.
torture: $(STAMPS)/install
	$(CMAKE) -DTFDB_TESTS=ON $(TREE) >/dev/null
	$(CMAKE) --preset torture >/dev/null
	$(CMAKE) --preset asan-damage >/dev/null
	for tree in $(TREE) build/torture; do \
	    $(CMAKE) --build $$tree -j $(JOBS) --target torture_store_shared torture_store_apply && \
	    $$tree/bin/torture_store_apply --seconds $$(($(TORTURE_SECONDS) / 8)) && \
	    $$tree/bin/torture_store_shared --seconds $$(($(TORTURE_SECONDS) / 2)) || exit 1; \
	done
	for tree in $(TREE) build/asan-damage; do \
	    $(CMAKE) --build $$tree -j $(JOBS) --target torture_store_damage && \
	    $$tree/bin/torture_store_damage --seconds $$(($(TORTURE_SECONDS) / 4)) || exit 1; \
	done

# Eight readers and two writers, processes that share a store: what they did is judged.
histories: $(STAMPS)/dev
	$(BIN)/python -m tests.isolation.long_run --seconds $(HISTORY_SECONDS)

# Loss, delay, reordering, cuts, kills and promotions. Several may run at once, with other seeds.
faults: $(STAMPS)/dev
	$(BIN)/python -m tests.net.network_faults --cycles $(FAULT_CYCLES) --seed $(FAULT_SEED)

fuzz: $(STAMPS)/dev
	$(CMAKE) --preset fuzz >/dev/null
	$(CMAKE) --build --preset fuzz -j $(JOBS)
	$(BIN)/python tools/run_fuzzers.py build/fuzz --seconds $(FUZZ_SECONDS)
	$(BIN)/python -m tests.hostile.fuzz --seconds $(FUZZ_SECONDS)
	$(BIN)/python -m tests.hostile.fuzz --seconds $(FUZZ_SECONDS) --threads

# 242 MB from PyPI and 10 s of compiling, once. Where it is missing, the tests that need it skip, but not
# with CI=true.
ros2: $(STAMPS)/install
	$(BIN)/python tools/make_ros2_env.py

# Everything that docs/benchmarks.md, docs/evaluation.md and docs/sweeps.md say in figures. The rivals go
# into an environment of their own; apt is asked for tf2 where it is missing.
measure/contenders/env: measure/contenders/install | $(STAMPS)/install
	measure/contenders/install
	@touch $@

measure: $(STAMPS)/install | measure/contenders/env
	$(BIN)/python -m tfdb_measure $(MEASURE)

# The rooms' own measurements, without rivals.
bench-rooms: $(STAMPS)/venv
	$(CMAKE) --preset bench >/dev/null
	$(CMAKE) --build --preset bench -j $(JOBS)
	for bench in build/bench/bin/bench_*; do echo "$$bench"; $$bench || exit 1; done

# -- upkeep ---------------------------------------------------------------------------------------

docs: $(STAMPS)/dev
	$(BIN)/python tools/make_docs.py build/docs

wheel: $(STAMPS)/dev
	$(BIN)/python tools/make_wheels.py --native

# docs/packaging.md says which Pythons it looks for.
$(STAMPS)/release: pyproject.toml | $(STAMPS)/dev
	$(PIP) install --no-build-isolation -e '.[release]'
	@touch $@

wheels: $(STAMPS)/release
	$(BIN)/python tools/make_wheels.py $(WHEELS)

stubs: $(STAMPS)/dev
	$(BIN)/python tools/make_stubs.py

format: $(STAMPS)/dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(CPP)

clean:
	rm -rf build dist out $(STAMPS) .pytest_cache .mypy_cache .ruff_cache .hypothesis

distclean: clean
	rm -rf $(VENV) .ros2
