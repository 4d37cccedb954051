# diptych on Debian 13, whose software Vulkan driver is 1.3 to 2.5 times as fast as Debian 12's.
#
#   docker build -t diptych .
#   docker run --rm -v "$PWD/out:/diptych/out" diptych    # make demo, into out/demo
#   docker run --rm diptych make test    # builds the tests first, in a profile of their own
#   docker run --rm diptych mpirun --allow-run-as-root -n 2 target/release/diptych render --out out/ranks
ARG RUST=1.95
FROM rust:${RUST}-trixie
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        libvulkan1 mesa-vulkan-drivers python3-venv libopenmpi-dev openmpi-bin libclang-dev \
    && rm -rf /var/lib/apt/lists/*
RUN rustup component add clippy rustfmt
WORKDIR /diptych
COPY . .
# `make` builds the program with the same features, and so finds it built.
ENV FEATURES=mpi
RUN cargo build --release --locked --features $FEATURES
CMD ["make", "demo"]
