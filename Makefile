# make demo    the built-in scene on two virtual devices: a stereo picture and a trace-file
# make test    format, lints, documentation, tests
# make test-view    the same for the window of `diptych view`, which needs Xvfb and xdotool to be tested
# make peers    diptych beside Mitsuba 3 with OIDN, both measured here: out/peers/NAME/NAME.md. SHOT=FILE for another shot
# make deps    checks for a Vulkan driver and compilers; installs Mesa's driver where apt-get is and none was found; says
#              where the software driver is an old, slow one
# make clean
#
# Everything is built in the release profile, so that the program, the tests and the benchmarks share one build of each
# dependency, and lints and documentation share one check of each.

CARGO ?= cargo
DIPTYCH := $(or $(CARGO_TARGET_DIR),target)/release/diptych
DEMO := out/demo
PEERS := out/peers
SHOT ?= builtin:cornell builtin:atrium

.PHONY: demo test test-view peers deps clean

demo: deps
	$(CARGO) build --release --locked
	"$(DIPTYCH)" render builtin:atrium --virtual 2 --out $(DEMO) --trace $(DEMO)/trace.json
	"$(DIPTYCH)" trace $(DEMO)/trace.json
	@echo
	@echo "picture, both eyes side by side: $(DEMO)/stereo.png"
	@echo "trace: $(DEMO)/trace.json (open it in https://ui.perfetto.dev)"

test: deps
	$(CARGO) fmt --check
	$(CARGO) clippy --release --locked --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --no-deps --release --locked
	XDG_RUNTIME_DIR="$${XDG_RUNTIME_DIR:-$${TMPDIR:-/tmp}}" $(CARGO) test --release --locked

test-view: deps
	$(CARGO) clippy --release --locked --all-targets --features view -- -D warnings
	XDG_RUNTIME_DIR="$${XDG_RUNTIME_DIR:-$${TMPDIR:-/tmp}}" $(CARGO) test --release --locked --features view --bin diptych --test view

# Python and its packages, none of which the program needs, are in a folder of their own.
peers: deps
	$(CARGO) build --release --locked
	[ -x $(PEERS)/venv/bin/pip ] || python3 -m venv $(PEERS)/venv
	$(PEERS)/venv/bin/pip install --quiet --disable-pip-version-check --requirement docs/peers/requirements.txt
	$(PEERS)/venv/bin/python docs/peers/measure.py --diptych '"$(DIPTYCH)"' --out $(PEERS) $(SHOT)

deps:
	@sh tools/deps.sh

clean:
	$(CARGO) clean
	rm -rf $(DEMO)
