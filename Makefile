# The two commands of a newcomer: `make demo` and `make test`. Everything else is CMake with its presets.
.PHONY: deps build demo test asan emulated bundle docs install format tidy clean

# install-deps has installed these: a test that does not find them fails instead of being skipped.
REQUIRED = INTERFLECT_TEST_REQUIRE=opencl:0,vulkan:0,blender,chromium,mkdocs,ffmpeg,mpi

deps:
	@scripts/install-deps.sh

build/release/build.ninja: | deps
	cmake --preset release

build: deps build/release/build.ninja
	cmake --build --preset release

demo: deps build/release/build.ninja
	cmake --build --preset release --target interflect-program
	@mkdir -p out
	build/release/bin/interflect solve scenes/cornell-box.obj --patches 5000 \
	  -o out/cornell-box.png -o out/cornell-box.glb --report out/cornell-box.json
	@echo "The picture is $(CURDIR)/out/cornell-box.png; the mesh beside it opens in Blender or any glTF viewer."

# All tests, then all of them again under the sanitizers, with the fuzzers.
test: build
	$(REQUIRED) ctest --preset release -j 2
	$(MAKE) asan

asan: deps
	cmake --preset asan
	cmake --build --preset asan
	$(REQUIRED) ctest --preset asan -j 2

# Only the tests on GPU drivers that run on the processor (PoCL, lavapipe).
emulated: build
	$(REQUIRED) ctest --preset release -L emulated -j 2

# The program with its shared libraries, as a folder and an archive that run elsewhere.
bundle: deps build/release/build.ninja
	cmake --build --preset release --target interflect-program
	scripts/make-bundle.sh build/release build/bundle

# The documentation as a site that opens from disk.
docs: deps
	mkdocs build --strict
	@echo "The site is $(CURDIR)/build/site/index.html"

install: build
	cmake --install build/release

format:
	git ls-files '*.h' '*.cpp' | xargs clang-format-14 -i

tidy: build
	git ls-files 'host/*.cpp' 'kernels/*.cpp' | xargs -P 2 -n 4 clang-tidy-14 -p build/release --quiet

clean:
	rm -rf build out
