# make demo    the built-in scene on two virtual devices: a stereo picture and a trace-file
# make test    format, lints, documentation, tests
# make test-view    the same for the window of `diptych view`, which needs Xvfb and xdotool to be tested
# make deps    checks for a Vulkan driver and compilers; installs Mesa's driver where apt-get is and none was found
# make clean
#
# Everything is built in the release profile, so that the program, the tests and the benchmarks share one build of each
# dependency, and lints and documentation share one check of each.

CARGO ?= cargo
DIPTYCH := $(or $(CARGO_TARGET_DIR),target)/release/diptych
DEMO := out/demo

# Mesa's layer that chooses among GPUs complains on every start where no Wayland server can be found: there, tests leave
# it out, as the program itself does.
ifndef XDG_RUNTIME_DIR
export NODEVICE_SELECT := 1
endif

.PHONY: demo test test-view deps clean

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
	$(CARGO) test --release --locked

test-view: deps
	$(CARGO) clippy --release --locked --all-targets --features view -- -D warnings
	$(CARGO) test --release --locked --features view --bin diptych --test view

deps:
	@sh tools/deps.sh

clean:
	$(CARGO) clean
	rm -rf $(DEMO)
