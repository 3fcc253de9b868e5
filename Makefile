# The build, the tests and the demo. `make build` leaves target/release/iprt.

# How shaderc is linked; looked up when used, so after setup.
SHADERC = $(shell scripts/shaderc-flags)
# Where cargo leaves the program.
IPRT = $(or $(CARGO_TARGET_DIR),target)/release/iprt
# cargo-nextest where it is installed.
RUNNER = $(shell cargo nextest --version >/dev/null 2>&1 && echo "nextest run" || echo test)

.PHONY: demo results chart strip gallery build test faults fuzz validation lint docs setup clean

demo: build
	mkdir -p out
	$(IPRT) render -o out/demo.png --timings 8

# docs/results.md: every method in every room. Interrupted, it goes on where it was.
ROOM = $(wildcard $(IPRT_DATA)/rooms/room/scene.toml)
SIZE = 320x180
results: build
	$(IPRT) chart apartment bedroom gallery $(ROOM) -o out/results-$(SIZE) --sweep methods \
		--size $(SIZE) --looks 1,16,64 --truth-spp 512 --rounds 3 --markdown docs/results.md

# A small chart of the settings, made within ten minutes on two cores.
chart: build
	$(IPRT) chart apartment -o out/chart --sweep small --markdown docs/results.md

# The film strip of docs/results.md.
strip: build
	scripts/film_strip
	cp out/film_strip/film_strip.jpg docs/images/film_strip.jpg

# docs/gallery.md: spheres of every lobe and the models of the test data, in one sheet.
gallery: build
	scripts/gallery
	cp out/gallery/spheres.jpg docs/images/spheres.jpg

build: setup
	cargo build --release --locked $(SHADERC)

# No Vulkan device and no validation layer is a failure, never a skip.
# The first run is of a build without a window, as for servers. Planted faults are in the second alone.
test: setup
	cargo $(RUNNER) --locked --no-default-features --test lean $(SHADERC)
	cargo $(RUNNER) --locked --features faults $(SHADERC)

# Every Vulkan call of five commands fails, one in each run; `make test` tries the first and last of each name.
faults: setup
	IPRT_FAULTS=all cargo $(RUNNER) --locked --features faults $(SHADERC) vulkan_faults::

# Ten minutes of mutated inputs, two for each reader; `make test` tries a few hundred.
fuzz: setup
	IPRT_FUZZ_SECONDS=120 cargo $(RUNNER) --locked --features faults $(SHADERC) fuzz::

# GPU-assisted validation, best practices and synchronization, in motion and in the window, on two drivers and two layers.
validation: build
	scripts/other_vulkan validation

lint: setup
	cargo fmt --check
	cargo clippy --locked --all-targets --features faults $(SHADERC) -- -D warnings
	cargo clippy --locked --all-targets --no-default-features $(SHADERC) -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps $(SHADERC)

# The parts of docs/ that are made from code.
docs: setup
	IPRT_BLESS=1 cargo test --locked $(SHADERC) --test headless docs::

setup:
	scripts/setup

clean:
	cargo clean
	rm -rf out
