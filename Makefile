# viscera with two commands: `make run` and `make test`. Everything else is CMake and Ninja.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
JOBS ?= $(shell nproc)
BIN := build/bin
OUT := out/stages
SOURCES = $$(find pipeline sim stages sample_data tests -name '*.[ch]pp' -o -name '*.cu' -o -name '*.cuh')

.PHONY: help packages all-packages programs build cuda build-times run paper study study-full cohort test check-format format clean \
        stage-labels stage-surface stage-tetmesh stage-simulate stage-report gpu-bundle test-gpu sanitize \
        docs gallery live soak measured wheel test-python bench-python bench-solver bench-body bench-error bench-support bench-mesh bench-gpu bench-surface bench-pipeline bench-live bench-all fuzz mutate odr

help: ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/' | expand -t 16

packages: ## install what running needs of .packages and this machine lacks (Debian, Ubuntu)
	@sh .ci/packages run

all-packages: ## install all of .packages but [gallery] and [docs]: for tests, cohorts and bundles too
	@sh .ci/packages run cohort test gpu

# The first of `make run` and `make build` configures; what `make build` or `make cuda` added stays.
build/build.ninja: | packages
	@cmake --preset run

programs: build/build.ninja ## compile every program, without tests and CUDA
	@ninja -C build -j $(JOBS) programs

build: all-packages ## compile everything: tests, benchmarks and, where nvcc is found, CUDA
	@grep -qs '^VISCERA_TESTS:BOOL=ON' build/CMakeCache.txt || cmake --preset release
	@ninja -C build -j $(JOBS)

cuda: build/build.ninja ## compile every program with the CUDA backend; needs nvcc
	@cmake -DVISCERA_CUDA=ON build
	@grep -q '^CMAKE_CUDA_COMPILER:[A-Z]*=/' build/CMakeCache.txt || { \
	  echo "cuda: nvcc not found; install the CUDA Toolkit and put its bin/ on PATH" >&2; exit 1; }
	@ninja -C build -j $(JOBS) programs

build-times: ## where compile time went: seconds of each folder, then of the 20 longest files
	@awk -F'\t' 'NR > 1 { last[$$4] = ($$2 - $$1) / 1000 } END { for (f in last) { \
	    n = split(f, part, "/"); if (n > 1) folder[part[1] "/" part[2]] += last[f] } \
	  for (d in folder) printf "%8.1f  %s/\n", folder[d], d }' build/.ninja_log | sort -rn
	@awk -F'\t' 'NR > 1 { last[$$4] = ($$2 - $$1) / 1000 } END { \
	  for (f in last) printf "%8.1f  %s\n", last[f], f }' build/.ninja_log | sort -rn | head -20

run: build/build.ninja ## the demo, to out/demo/report.html; compiles the programs that it needs
	@ninja -C build -j $(JOBS) demo
	@$(BIN)/viscera run configs/demo.yaml

live: programs $(OUT)/tetmesh/manifest.json ## the phantom liver to take in the hand: a window
	@$(BIN)/viscera-live configs/scenes/drop.yaml --in mesh=$(OUT)/tetmesh/mesh.vtu

# Gates that fail (5) and runs that diverge (7) are results here: the page shows them.
SHOWN = || { code=$$?; [ $$code -eq 5 ] || [ $$code -eq 7 ]; }

paper: programs ## the source paper's experiments, to out/paper/compare.html
	@$(BIN)/viscera run configs/paper.yaml $(SHOWN)

study: programs ## what accuracy costs in time, to out/study/compare.html: three quarters of an hour
	@$(BIN)/viscera run configs/study.yaml $(SHOWN)

study-full: programs ## the same in full, to out/study_full/compare.html: many hours
	@$(BIN)/viscera run configs/study_full.yaml $(SHOWN)

COHORT ?= configs/cohort.yaml
COHORT_PROFILE ?= pipeline/cohort/local
cohort: programs ## the cases of COHORT through Snakemake, here or by COHORT_PROFILE=pipeline/cohort/slurm
	@sh .ci/packages cohort
	@snakemake --snakefile pipeline/cohort/Snakefile --profile $(COHORT_PROFILE) \
	  --config spec=$(COHORT) $(COHORT_CONFIG)

test: build ## every test, and why some were skipped; one kind: test-unit -property -verification -hard -cli -web
	@JOBS=$(JOBS) .ci/tests

# test-gpu is below: it fails without a device.
TEST_KINDS = unit property verification hard cli web
$(TEST_KINDS:%=test-%): test-%: build
	@JOBS=$(JOBS) .ci/tests -L '^$*$$'

DOCS := build/docs
docs: programs ## the documentation site, to build/docs/site/index.html
	@sh .ci/packages docs
	@python3 docs/site/generate.py $(BIN) $(DOCS)/pages
	@cp docs/site/CMakeGraphVizOptions.cmake build && cmake --graphviz=$(DOCS)/targets.dot -S . -B build >/dev/null 2>&1
	@docs/site/draw-targets $(DOCS)/targets.dot >$(DOCS)/pages/targets.svg
	@{ cat docs/site/Doxyfile; echo 'OUTPUT_DIRECTORY = $(DOCS)/pages'; } | doxygen -
	@mkdocs build --quiet --strict --config-file $(DOCS)/mkdocs.yml
	@echo $(DOCS)/site/index.html

# The simulations run one after the other, since their times are shown. Those are the times of the run
# that the cache holds: `viscera run configs/gallery.yaml --from simulate --jobs 1` takes them again.
# Pictures are drawn by Debian's Python, whose packages VTK and h5py are.
gallery: programs ## eight scenes with picture, YAML and cost, to build/docs/gallery; `make docs` shows them
	@sh .ci/packages gallery
	@$(BIN)/viscera run configs/gallery.yaml --jobs 1
	@xvfb-run -a /usr/bin/python3 docs/site/gallery/gallery.py out/gallery $(DOCS)/gallery
	@echo $(DOCS)/gallery/index.md

# The demo's stages by hand, each on the files of the one before, with the settings of
# configs/demo.yaml. A missing input is made first.
stage-labels: programs ## viscera-labels on the phantom, into out/stages/labels
	$(BIN)/viscera-labels --in volume=sample_data/phantom.nrrd \
	  --set 'labels={liver: 1, tumour: 2, vessels: 3}' --out $(OUT)/labels

stage-surface: programs $(OUT)/labels/manifest.json ## viscera-surface, into out/stages/surface
	$(BIN)/viscera-surface --in labels=$(OUT)/labels/labels.nrrd --out $(OUT)/surface

stage-tetmesh: programs $(OUT)/surface/manifest.json ## viscera-tetmesh, into out/stages/tetmesh
	$(BIN)/viscera-tetmesh --in labels=$(OUT)/labels/labels.nrrd \
	  --in surface=$(OUT)/surface/surface.vtp --set cell_size=10.3mm --out $(OUT)/tetmesh

stage-simulate: programs $(OUT)/tetmesh/manifest.json ## viscera-simulate, into out/stages/simulate
	$(BIN)/viscera-simulate --in mesh=$(OUT)/tetmesh/mesh.vtu \
	  --in scene=configs/scenes/drop.yaml --out $(OUT)/simulate

stage-report: programs $(OUT)/simulate/manifest.json ## viscera-report, into out/stages/report
	$(BIN)/viscera-report --in labels=$(OUT)/labels/labels.nrrd \
	  --in surface=$(OUT)/surface/surface.vtp --in mesh=$(OUT)/tetmesh/mesh.vtu \
	  --in trajectory=$(OUT)/simulate/trajectory.h5 \
	  --set 'title=Phantom liver dropped on the ground' --out $(OUT)/report

$(OUT)/%/manifest.json:
	@$(MAKE) --no-print-directory stage-$*

gpu-bundle: build ## build/gpu-bundle, to be copied to a GPU node
	@$(BIN)/viscera run configs/gpu/meshes.yaml --quiet
	@.ci/gpu-bundle

test-gpu: build ## the GPU tests on this machine; fails without a device
	@$(BIN)/viscera run configs/gpu/meshes.yaml --case 16mm --quiet
	@VISCERA_REQUIRE_GPU=1 VISCERA_GPU_MESH=out/meshes/16mm/mesh.vtu \
	  VISCERA_GPU_SCENE=configs/scenes/drop.yaml $(BIN)/test_gpu

# Debian's: of another Python, the packages that the wheel is made with may be absent.
PYTHON ?= /usr/bin/python3
WHEEL = build/wheel

wheel: ## the Python package, build/wheel/dist/viscera-*.whl, for pip install; WHEEL_OPTIONS=-DVISCERA_CUDA=ON
	@sh .ci/packages run python
	@cmake --preset wheel -DPython_EXECUTABLE=$(PYTHON) $(WHEEL_OPTIONS) >/dev/null
	@ninja -C $(WHEEL) -j $(JOBS) viscera_python viscera_preparation viscera_report_page
	@rm -rf $(WHEEL)/dist && $(PYTHON) -m build --wheel --no-isolation --outdir $(WHEEL)/dist $(WHEEL)/package >/dev/null
	@ls -sh $(WHEEL)/dist/*.whl

test-python: wheel programs ## the wheel's tests, in an environment of its own without network
	@$(PYTHON) -m venv --clear --system-site-packages $(WHEEL)/venv
	@$(WHEEL)/venv/bin/pip install --quiet --no-index --no-deps $(WHEEL)/dist/*.whl
	@$(WHEEL)/venv/bin/python -m pytest -q -rs -p no:cacheprovider tests/python

bench-python: test-python ## an array of ids to positions, in Python and by the programs: BENCH_PYTHON_TETS, _FRAMES
	@$(WHEEL)/venv/bin/python tests/bench/python_time.py $(BIN) $(BENCH_PYTHON_TETS) $(BENCH_PYTHON_FRAMES)

BENCH_PYTHON_TETS ?= 50000
BENCH_PYTHON_FRAMES ?= 10

BENCH = build/bench

$(BENCH)/mesh.vtu: build  # the phantom in 30k tets
	@$(BIN)/viscera run configs/demo.yaml --set tetmesh.target_tets=30000 --until tetmesh \
	  --out $(BENCH) --quiet && cp $(BENCH)/demo/tetmesh/mesh.vtu $(BENCH)/mesh.vtu

BENCH_MESHES ?= $(BENCH)/mesh.vtu
BENCH_SOLVER_CSV ?= docs/results/solver_speed.csv
bench-solver: $(BENCH)/mesh.vtu ## what a substep costs on this machine, by method and threads: BENCH_MESHES, _SOLVER_CSV
	@$(BIN)/bench_solver $(BENCH_SOLVER_CSV) $(BENCH_MESHES)

BENCH_BODY_CSV ?= out/bench/body.csv
BENCH_NU ?= 0.3,0.45,0.49,0.499
bench-body: $(BENCH)/mesh.vtu ## how far linear tets and smoothed elements are off quadratic ones, and what they cost: BENCH_MESHES, _NU, _BODY_CSV
	@mkdir -p out/bench && $(BIN)/bench_body $(BENCH_BODY_CSV) $(BENCH_NU) $(BENCH_MESHES) bar

BENCH_ERROR_CSV ?= out/bench/error_bar.csv
bench-error: build ## error bars beside true errors, where these are known: BENCH_ERROR_MESHES (livers of some 4,000 tets), _CSV
	@mkdir -p out/bench && $(BIN)/bench_error $(BENCH_ERROR_CSV) $(BENCH_ERROR_MESHES)

BENCH_SUPPORT_CSV ?= out/bench/support.csv
bench-support: build ## what a support's border costs, by region and by vertices: BENCH_SUPPORT_MESHES (the first is the reference), _CSV
	@mkdir -p out/bench && $(BIN)/bench_support $(BENCH_SUPPORT_CSV) 0.45 $(BENCH_SUPPORT_MESHES)

# Where the data of measured bodies lie (docs/results/measured/measured.md says which and whence); those that
# are not there are skipped.
VISCERA_MEASURED ?=
MEASURED_OUT ?= out/measured
measured: build ## measured bodies beside what is computed of them, with pictures: VISCERA_MEASURED (the data's folder), MEASURED_OUT
	@$(BIN)/measured $(MEASURED_OUT) $(VISCERA_MEASURED)

BENCH_GPU_CSV ?= out/bench/gpu.csv
bench-gpu: $(BENCH)/mesh.vtu ## what accuracy costs on this machine's GPU: BENCH_MESHES, _GPU_CSV
	@mkdir -p out/bench && $(BIN)/bench_gpu $(BENCH_GPU_CSV) 5 0.45 $(BENCH_MESHES)

BENCH_VOLUME ?= sample_data/phantom.nrrd
BENCH_LABELS ?= {body: [1, 2, 3]}
BENCH_TETS ?= 5000 54000 215000
BENCH_REPEATS ?= 3
BENCH_CSV ?= out/bench/mesh.csv
bench-mesh: build ## our tets, make_mesh_3's and HXT's on one body: BENCH_VOLUME, _LABELS, _TETS, _REPEATS, _CSV
	@mkdir -p $(dir $(BENCH_CSV))
	@$(BIN)/bench_mesh $(BENCH_VOLUME) '$(BENCH_LABELS)' $(BENCH_CSV) $(BENCH_REPEATS) $(BENCH_TETS)

BENCH_SURFACES ?= sample_data/phantom.nrrd
BENCH_SURFACE_CSV ?= out/bench/surface.csv
bench-surface: build ## surfaces of every label against their goals: BENCH_SURFACES (volumes), _SURFACE_CSV
	@mkdir -p $(dir $(BENCH_SURFACE_CSV))
	@$(BIN)/bench_surface $(BENCH_SURFACE_CSV) $(BENCH_SURFACES)

LIVE_FRAMES ?= 600
LIVE_MESH ?= $(BENCH)/mesh.vtu
LIVE_SET ?=
bench-live: $(LIVE_MESH) ## the live loop without a window, 30k tets: LIVE_FRAMES, _MESH, _SET (--set …)
	@$(BIN)/viscera-live configs/scenes/drop.yaml --in mesh=$(LIVE_MESH) $(LIVE_SET) \
	  --headless $(LIVE_FRAMES) --quiet

# 216,000 frames are an hour of the body's time.
SOAK_FRAMES ?= 216000
soak: programs $(OUT)/tetmesh/manifest.json ## the live loop under random input: SOAK_FRAMES
	@$(BIN)/viscera-live configs/scenes/drop.yaml --in mesh=$(OUT)/tetmesh/mesh.vtu \
	  --headless $(SOAK_FRAMES) --random 1

BENCH_KILLS ?= 200
bench-pipeline: build ## the engine's own cost, and BENCH_KILLS kills (0: no faults), full disks, many engines
	@$(BIN)/bench_pipeline
	@[ $(BENCH_KILLS) -eq 0 ] || VISCERA_KILLS=$(BENCH_KILLS) $(BIN)/test_cli --gtest_brief=1 \
	  --gtest_filter='Killed.*:FullDisk.*:ManyEngines.*:ReadOnlyCache.*:Clock.*:Upkeep.*:*StageFails*'

# Benchmarks that take little are run three times in turn, so that the interval of a figure contains what the machine
# does from minute to minute. The targets are made as they stand, but for `build`, which is done by then.
BENCH_HISTORY ?= docs/results/history.jsonl
BENCH_ALL = out/bench/all
BENCH_ONE = $(MAKE) --no-print-directory -o build BENCH_MESHES=$(BENCH)/mesh.vtu
bench-all: build $(BENCH)/mesh.vtu ## solver, live, mesh, pipeline and GPU in short, ten minutes: a line in BENCH_HISTORY, and out/bench/history.html
	@rm -rf $(BENCH_ALL) && mkdir -p $(BENCH_ALL)
	@{ git rev-parse --short HEAD || echo unknown; git diff --quiet HEAD -- ':!docs/results/history.jsonl' || echo +changes; } | \
	  tr -d '\n' >$(BENCH_ALL)/commit.txt
	@set -e; for run in 1 2 3; do \
	  echo "bench-all: solver, live and mesh, run $$run of 3"; \
	  $(BENCH_ONE) bench-solver BENCH_SOLVER_CSV=$(BENCH_ALL)/solver_$$run.csv >/dev/null; \
	  $(BENCH_ONE) bench-live LIVE_FRAMES=150 LIVE_MESH=$(BENCH)/mesh.vtu LIVE_SET= >$(BENCH_ALL)/live_$$run.json; \
	  $(BENCH_ONE) bench-mesh BENCH_CSV=$(BENCH_ALL)/mesh_$$run.csv BENCH_VOLUME=sample_data/phantom.nrrd \
	    'BENCH_LABELS={body: [1, 2, 3]}' BENCH_TETS=54000 BENCH_REPEATS=1 >/dev/null; \
	done
	@echo "bench-all: pipeline"
	@$(BENCH_ONE) bench-pipeline BENCH_KILLS=0 >$(BENCH_ALL)/pipeline_1.txt
	@if ! nvidia-smi --query-gpu=name --format=csv,noheader >$(BENCH_ALL)/gpu.txt 2>/dev/null; then \
	  rm $(BENCH_ALL)/gpu.txt; echo "bench-all: GPU skipped: nvidia-smi finds no CUDA device"; \
	elif grep -q 'this build has no CUDA backend' $(BIN)/bench_gpu; then \
	  rm $(BENCH_ALL)/gpu.txt; echo "bench-all: GPU skipped: this build has no CUDA backend; make cuda"; \
	else \
	  echo "bench-all: GPU"; $(BENCH_ONE) bench-gpu BENCH_GPU_CSV=$(BENCH_ALL)/gpu_1.csv >/dev/null; \
	fi
	@python3 tests/bench/history.py $(BENCH_ALL) $(BENCH_HISTORY) out/bench/history.html

# ThreadSanitizer sees every pair of threads in the tests of equal bits; the rest has one thread.
# AddressSanitizer is spared the seconds of motion that run the same code again and again, and VTK's
# threads: a copy of the process that reads a file (trial_read.hpp) would wait for the lock of the
# sanitizer's allocator, when one of them held it at that moment. The fuzzers are of the same build.
# The Python module runs in an interpreter that has the sanitizer loaded before it; tests that start
# programs, or weigh the process, are for `make test-python`.
sanitize: all-packages ## unit tests and the Python module under Address- and UndefinedBehaviourSanitizer, threads under ThreadSanitizer
	@sh .ci/packages run python
	@cmake --preset sanitized -DVISCERA_PYTHON=ON -DPython_EXECUTABLE=$(PYTHON) >/dev/null && ninja -C build/sanitized -j $(JOBS) test_contract test_engine \
	  test_sim test_blocks test_properties test_tet_io test_surface_io test_trajectory_io test_improve test_live_session \
	  test_labels test_surface test_tet_exchange test_report viscera_python
	@VTK_SMP_BACKEND_IN_USE=Sequential ASAN_OPTIONS=detect_container_overflow=0 \
	  LSAN_OPTIONS=suppressions=$(CURDIR)/.ci/fuzz_leaks:print_suppressions=0 \
	  ctest --test-dir build/sanitized -L 'unit|property' -E 'ComesToRest|Equilibrium|Decays|Threads|^Bar|^StiffBar.*Newton|^SweepError|AllAgreeOnABar' \
	  --output-on-failure -j $(JOBS)
	@LD_PRELOAD=$$(clang -print-file-name=libclang_rt.asan-$$(uname -m).so) \
	  ASAN_OPTIONS=detect_leaks=0:detect_container_overflow=0 PYTHONPATH=build/sanitized/package \
	  $(PYTHON) -m pytest -q -p no:cacheprovider -k 'not program and not leave_no_memory' \
	  tests/python/test_errors.py tests/python/test_simulation.py
	@cmake --preset sanitized-threads >/dev/null && ninja -C build/sanitized-threads -j $(JOBS) test_sim
	@ctest --test-dir build/sanitized-threads -R 'SameBits|Threads' --output-on-failure

# The types of all programs are compared in one link, each with its main; -flinker-output=rel spares it
# the code. ODR_BUILD may be any folder that is configured with VISCERA_ODR.
ODR_BUILD ?= build/odr
odr: all-packages ## read all programs as one whole and refuse types of one name that are not one type
	@grep -qs '^VISCERA_ODR:BOOL=ON' $(ODR_BUILD)/CMakeCache.txt || cmake -G Ninja -S . -B $(ODR_BUILD) \
	  -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS_RELEASE='-O0 -DNDEBUG' \
	  -DVISCERA_ODR=ON -DVISCERA_TESTS=OFF -DVISCERA_CUDA=OFF >/dev/null
	@cd $(ODR_BUILD) && objects=$$(ninja -t targets all | \
	    sed -n -E 's/^((pipeline|sample_data|sim|stages)\/.*\.cpp\.o): .*/\1/p') && \
	  ninja -j $(JOBS) $$objects && \
	  $(CXX) -O0 -flto=auto -Werror=odr -Werror=lto-type-mismatch -r -flinker-output=rel -nostdlib \
	    -Wl,-z,muldefs -o all.o $$objects

fuzz: all-packages ## the readers of every file that viscera takes under libFuzzer (FUZZ_SECONDS each, FUZZ_ONLY)
	@.ci/fuzz

MUTATE ?=
mutate: build ## break the code on purpose and list which tests noticed, hours: docs/results/mutants.md; MUTATE (--quick, --only N)
	@JOBS=$(JOBS) .ci/mutate $(MUTATE)

format: ## bring every source into the house style
	@clang-format -i $(SOURCES)

check-format: ## fail when a source is not in the house style
	@clang-format --dry-run -Werror $(SOURCES)

clean: ## remove build/; results and cache in out/ stay
	@rm -rf build
