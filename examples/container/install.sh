#!/bin/sh
# What the image is made of; the Dockerfile runs it, and so do the tests, as far as they can without Docker.
#   install.sh system             packages of Debian that the program needs to run
#   install.sh program SOURCE TO  the program and its libraries, in a virtual environment of their own
#   install.sh check FROM         the installed program renders some frames of the demo it has with it
set -eu

system() {
    apt-get update
    apt-get install --yes --no-install-recommends python3 libegl1 libgl1-mesa-dri
    rm -rf /var/lib/apt/lists/*
}

# EXTRAS=torch for the GPU; PIP_* as pip knows them.
program() {
    source=$1 to=$2
    "${PYTHON:-python3}" -m venv "$to"
    "$to/bin/pip" install --quiet --no-compile --constraint "$source/constraints.txt" "$source${EXTRAS:+[$EXTRAS]}"
    "$to/bin/python" -m pip uninstall --quiet --yes setuptools pip
    # The file system will be read-only: what Python compiles it compiles now.
    "$to/bin/python" -m compileall -q -j 0 "$to/lib" || true # some libraries carry templates that are no Python yet
}

check() {
    from=$1
    demo=$("$from/bin/python" -I -c "import ar_demo, pathlib; print(pathlib.Path(ar_demo.__file__).parent / 'assets')")
    work=$(mktemp -d)
    "$from/bin/ar-replace" "$demo/demo.mp4" "$demo/ad.mp4" --quad 476.3,128.1 759.4,121.6 758.8,479.7 481.7,476.3 \
        --end 5 --quiet --json -o "$work/out.mp4"
    rm -r "$work"
}

"$@"
