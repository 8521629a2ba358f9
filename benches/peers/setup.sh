#!/usr/bin/env bash
#
# Installs the renderers that wavecast is compared with into target/peers/venv, and builds wavecast.
#
#   benches/peers/setup.sh
#
# The wheels of Blender's module exist for one version of Python each: 5.0 for 3.11, 5.1 for 3.13. PYTHON names another
# interpreter than python3. Mitsuba's fast variant wants an LLVM that is no part of its wheel: Debian's libllvm19.

set -euo pipefail

here=$(dirname -- "$(realpath -- "${BASH_SOURCE[0]}")")
root=$(realpath -- "$here/../..")
venv=$root/target/peers/venv

"${PYTHON:-python3}" -m venv "$venv"
"$venv/bin/pip" install --quiet --requirement "$here/requirements.txt"
if ! compgen -G '/usr/lib/*/libLLVM.so.19*' >/dev/null && [[ -z ${DRJIT_LIBLLVM_PATH-} ]]; then
    echo 'error: Mitsuba needs LLVM: apt-get install libllvm19, or DRJIT_LIBLLVM_PATH=…/libLLVM.so' >&2
    exit 1
fi
cd "$root"
cargo build --release --locked --bin wavecast
echo "$venv/bin/python $here/compare.py"
