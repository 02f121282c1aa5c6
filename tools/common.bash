# Paths, messages and the environment that the commands beside this file share. Sourced by them.

set -euo pipefail

say() { printf 'people_fusion: %s\n' "$*" >&2; }

die() {
  say "error: $*"
  exit 1
}

checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
workspace=$checkout/.workspace
venv=$workspace/venv
oracles=$workspace/oracles
logs=$workspace/log

if [ ! -w "${HOME:-/nowhere}" ]; then # unset, as under some runners, or a daemon's
  HOME=$(unset HOME && echo ~)
  [ -w "$HOME" ] || HOME=/var/tmp/people_fusion-$(id -u)
  export HOME
  mkdir -p -m 700 "$HOME"
  [ -O "$HOME" ] || die "$HOME belongs to somebody else; set HOME"
fi
# Outside the checkout: rosrun takes every executable file below a package for one of its nodes, build products too.
catkin=${XDG_CACHE_HOME:-$HOME/.cache}/people_fusion/$(sha256sum <<< "$checkout" | cut -c 1-12)

# Variables of another Python or ROS workspace would lead commands astray.
sanitise() {
  unset PYTHONPATH PYTHONHOME PYTHONSTARTUP VIRTUAL_ENV PYENV_VERSION BASH_ENV CDPATH
  unset CMAKE_PREFIX_PATH ROS_PACKAGE_PATH ROS_ROOT ROS_ETC_DIR PKG_CONFIG_PATH
  export PATH="$venv/bin:/usr/sbin:/usr/bin:/sbin:/bin${PATH:+:$PATH}"
  export LC_ALL=C.UTF-8
}

source_quietly() { # setup files of ROS read variables that are not set
  set +u
  # shellcheck disable=SC1090
  source "$1"
  set -u
}

# The environment of the built workspace.
enter() {
  sanitise
  source_quietly "$catkin/devel/setup.bash"
  export PATH="$venv/bin:$PATH"
}

# A ROS graph of its own on this machine, whatever robot the user's shell points at.
isolate() {
  unset ROS_IP ROS_NAMESPACE
  export ROS_HOSTNAME=localhost ROS_HOME="$workspace/ros" ROS_MASTER_URI="http://localhost:$(free_port)"
}

free_port() {
  /usr/bin/python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])'
}
