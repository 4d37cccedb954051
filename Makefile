# CONTRIBUTING.md lists the targets with their variables. Without one, `make` runs `make demo`.
#
# `make lint` uses the profile of `make test`: clippy and the documentation share one check of each dependency, and the
# tests share the build scripts and procedural macros. Everything else is built in the release profile, so that the
# program and the benchmarks share one build of each dependency.

CARGO ?= cargo
RUSTC ?= rustc
HOST = $(shell $(RUSTC) -vV | sed -n 's/^host: //p')
BUILD := $(CARGO) build --release --locked $(if $(FEATURES),--features $(FEATURES))
DIPTYCH := $(or $(CARGO_TARGET_DIR),target)/release/diptych
DEMO := out/demo
PEERS := out/peers
SHOT ?= builtin:cornell builtin:atrium

# Without a Wayland server, Mesa's device-selection layer complains on every start. Tests then disable it, like the
# program does.
ifndef XDG_RUNTIME_DIR
export NODEVICE_SELECT := 1
endif

# Commands may use a variable of that name.
unexport NEWER_MESA

# Unit tests that need an adapter, by parts of their names.
NEED_ADAPTER := rejects_faulty_shaders non_finite_history light_density_tests missing_light_does_not_depend

# Runner for tests in Cargo.
ifneq ($(RUN),)
export CARGO_TARGET_$(shell echo $(HOST) | tr a-z- A-Z_)_RUNNER := $(RUN)
endif

.PHONY: demo lint test test-no-adapter test-full test-view test-hardware-rays test-mpi test-xr python archive golden gpu-kernels release-check peers peers-packages numbers docs deps clean

demo: deps
	$(BUILD)
	"$(DIPTYCH)" render builtin:atrium --virtual 2 --frames 8 --out $(DEMO)/frames --trace $(DEMO)/trace.json
	cp $(DEMO)/frames/stereo.0007.png $(DEMO)/stereo.png
	"$(DIPTYCH)" trace $(DEMO)/trace.json
	"$(DIPTYCH)" render builtin:studio --size 320x180 --frames 8 --fps 2 --also sheet --out $(DEMO)/motion
	cp $(DEMO)/motion/sheet.png $(DEMO)/motion.png
	@echo
	@echo "the eighth frame, both eyes side by side: $(DEMO)/stereo.png"
	@echo "a scene that moves, every half a second: $(DEMO)/motion.png"
	@echo "trace: $(DEMO)/trace.json (open it in https://ui.perfetto.dev)"

lint:
	$(CARGO) fmt --check
	$(CARGO) clippy --profile tests --locked --all-targets --features view,xr,python -- -D warnings
	$(CARGO) clippy --profile tests --locked -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --no-deps --profile tests --locked --features view,xr
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --no-deps --profile tests --locked
	cd tools/lint && $(CARGO) fmt --check
	cd tools/lint && $(CARGO) clippy --quiet --locked --all-targets -- -D warnings
	cd tools/lint && $(CARGO) test --quiet --locked
	cd tools/lint && $(CARGO) run --quiet --locked -- ../..

test: deps
	$(CARGO) test --profile tests --locked --lib --bins --tests
	$(CARGO) test --profile tests --locked --doc

# Hides Vulkan drivers, so that a new test that needs an adapter also fails where there is one.
test-no-adapter: export VK_DRIVER_FILES := /nonexistent
test-no-adapter: export VK_ICD_FILENAMES := /nonexistent
test-no-adapter:
	$(CARGO) test --profile tests --locked $(ARGS) --lib --test models --test fuzz -- \
		$(addprefix --skip ,$(NEED_ADAPTER))

test-full: deps
	DIPTYCH_TEST_FULL=1 $(CARGO) test --release --locked --no-fail-fast -- --include-ignored
	$(CARGO) run --release --locked -p diptych --example render_frame

test-view: deps
	$(CARGO) test --release --locked --features view --bin diptych --test view

test-hardware-rays: deps
	$(CARGO) build --release --locked
	@$(RUN) "$(DIPTYCH)" info --json | grep -q '"ray_queries": true' || { \
		echo "no adapter here has ray queries, which these tests are of: Mesa's software driver has them in version 25" >&2; exit 1; }
	DIPTYCH_TRAVERSAL=hardware $(CARGO) test --release --locked --test renderer

# Separate copies of the programs, so that other targets do not overwrite or use them.
MPI := out/mpi

test-mpi: deps
	@sh tools/deps-mpi.sh
	$(CARGO) clippy --release --locked --all-targets --features mpi -- -D warnings
	$(CARGO) build --release --locked --features mpi
	mkdir -p $(MPI)/bin
	cp "$(DIPTYCH)" $(MPI)/bin/diptych
	sh tools/test-mpi.sh $(MPI)/bin/diptych mpirun $(MPI)/runs
	@if command -v mpicc.mpich >/dev/null; then set -e; \
		MPICC=mpicc.mpich CARGO_TARGET_DIR=target/mpich $(CARGO) build --release --locked --features mpi; \
		cp target/mpich/release/diptych $(MPI)/bin/diptych-mpich; \
		sh tools/test-mpi.sh $(MPI)/bin/diptych-mpich mpirun.mpich $(MPI)/runs-mpich; \
	fi

test-xr: deps
	$(CARGO) test --release --locked --features xr --lib headset
	$(CARGO) build --release --locked --features xr
	mkdir -p out/xr/bin
	cp "$(DIPTYCH)" out/xr/bin/diptych
	$(RUN) sh tools/test-xr.sh out/xr/bin/diptych out/xr/runs

# The wheel's library and the program, with which the tests compare it, share one build of each dependency.
python: deps
	$(BUILD)
	rm -rf out/python/venv out/python/wheels
	python3 -m venv out/python/venv
	out/python/venv/bin/pip install --quiet --disable-pip-version-check pytest psutil mypy OpenEXR
	out/python/venv/bin/pip install --quiet --disable-pip-version-check nbclient ipykernel matplotlib jupyter_rfb || \
		echo "the notebook and the view are not tested, because its packages cannot be installed"
	out/python/venv/bin/pip install --quiet --disable-pip-version-check pyoidn || \
		echo "the example with OIDN is not tested, because pyoidn cannot be installed"
	python3 tools/licences.py --target $(HOST) --features python >python/LICENSE-THIRD-PARTY.txt
	out/python/venv/bin/pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir out/python/wheels ./python
	out/python/venv/bin/pip install --quiet --disable-pip-version-check out/python/wheels/diptych-*.whl
	MYPY_CACHE_DIR=out/python/mypy out/python/venv/bin/python -m mypy --config-file python/pyproject.toml python/diptych
	MYPY_CACHE_DIR=out/python/mypy out/python/venv/bin/python -m mypy.stubtest \
		--mypy-config-file python/pyproject.toml diptych
	DIPTYCH="$(abspath $(DIPTYCH))" $(RUN) out/python/venv/bin/python -m pytest -q --import-mode=importlib python/tests

archive: deps
	$(BUILD)
	sh tools/archive.sh "$(DIPTYCH)" $(HOST) "$(FEATURES)" out/archive

golden: deps
	$(BUILD)
	mkdir -p out
	$(RUN) sh tools/golden.sh "$(DIPTYCH)" out/golden.txt
	@[ -z "$(BEFORE)" ] || { diff "$(BEFORE)" out/golden.txt && echo "all images are the same"; }

gpu-kernels: deps
	$(BUILD)
	mkdir -p out
	python3 tools/gpu-kernels/measure.py --diptych "$(DIPTYCH)" --under "$(NEWER_MESA)" $(ARGS)

release-check:
	@MAKE="$(MAKE)" NEWER_MESA="$(NEWER_MESA)" sh tools/release-check.sh $(STEPS)

# Python packages live in a separate virtual environment. The program needs none of them.
peers: deps peers-packages
	$(BUILD)
	$(PEERS)/venv/bin/python docs/results/peers/measure.py --diptych '"$(DIPTYCH)"' --out $(PEERS) $(if $(HISTORY),--history) $(SHOT)

peers-packages:
	[ -x $(PEERS)/venv/bin/pip ] || python3 -m venv $(PEERS)/venv
	$(PEERS)/venv/bin/pip install --quiet --disable-pip-version-check --requirement docs/results/peers/requirements.txt

numbers: deps $(if $(WITH_PEERS),peers-packages)
	$(BUILD)
	python3 tools/results/measure.py --diptych "$(DIPTYCH)" --tables "$(TABLES)" $(if $(SCENES),--scenes "$(SCENES)") \
		$(if $(NEWER_MESA),--driver "$(NEWER_MESA)") $(if $(WITH_PEERS),--peers $(PEERS)/venv/bin/python) $(ARGS)

docs:
	CARGO="$(CARGO)" sh tools/docs.sh out/docs

deps:
	@sh tools/deps.sh

clean:
	$(CARGO) clean
	rm -rf $(DEMO) tools/lint/target
