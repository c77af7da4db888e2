#!/bin/sh
# Installs the navigation service on a machine with systemd, or takes it off again.
#
#   deploy/install.sh install   [--root DIR] [--binary FILE]
#   deploy/install.sh uninstall [--root DIR] [--purge]
#
# --root DIR     stage below DIR instead of /; nothing is then started, stopped or created on this machine
# --binary FILE  the executable; without it target/release/ilns of this source tree
# --purge        remove configuration and recordings, too
#
# Configuration that is already there is never overwritten: the new one is put beside it as FILE.new.
set -eu

here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
units="ilns-bus ilns-preprocessor ilns-solver ilns-propagator ilns-recorder ilns-monitor"

fail() {
    echo "install.sh: $1" >&2
    exit 2
}

usage="install or uninstall, then --root DIR, --binary FILE, --purge (the head of this file explains them)"
[ $# -ge 1 ] || fail "expected $usage"
action=$1
shift
root=
binary=$here/../target/release/ilns
purge=no
while [ $# -gt 0 ]; do
    case $1 in
        --root | --binary)
            [ $# -ge 2 ] || fail "$1 expects a value"
            if [ "$1" = --root ]; then root=${2%/}; else binary=$2; fi
            shift 2
            ;;
        --purge)
            purge=yes
            shift
            ;;
        *) fail "$1 is unknown; expected $usage" ;;
    esac
done
if [ -z "$root" ] && [ "$(id -u)" -ne 0 ]; then
    fail "only root installs into /; use sudo, or --root DIR to stage elsewhere"
fi

bin=$root/usr/local/bin
etc=$root/etc/ilns
doc=$root/usr/local/share/doc/ilns
system=$root/etc/systemd/system
sysusers=$root/etc/sysusers.d
tmpfiles=$root/etc/tmpfiles.d

# Configuration belongs to whoever edits it.
configure() {
    if [ -e "$2" ] && ! cmp -s "$1" "$2"; then
        install -m 0644 "$1" "$2.new"
        echo "install.sh: $2 is yours and stays; the new one is $2.new"
    else
        install -m 0644 "$1" "$2"
    fi
}

do_install() {
    [ -x "$binary" ] || fail "$binary is no executable (cargo build --release makes it, --binary FILE names another)"
    install -d "$bin" "$etc" "$doc" "$system" "$sysusers" "$tmpfiles" "$root/usr/local/lib/ilns"
    # A running executable cannot be written to, but it can be replaced.
    install -m 0755 "$binary" "$bin/ilns.new"
    mv -f "$bin/ilns.new" "$bin/ilns"
    configure "$here/navigator.toml" "$etc/navigator.toml"
    configure "$here/vehicle.toml" "$etc/processes.toml"
    install -m 0644 "$here/README.md" "$doc/README.md"
    for unit in "$here"/systemd/*.service "$here"/systemd/*.target; do
        install -m 0644 "$unit" "$system/"
    done
    install -m 0644 "$here/systemd/ilns.sysusers" "$sysusers/ilns.conf"
    install -m 0644 "$here/systemd/ilns.tmpfiles" "$tmpfiles/ilns.conf"
    if [ -z "$root" ]; then
        systemd-sysusers ilns.conf
        systemd-tmpfiles --create ilns.conf
        systemctl daemon-reload
        for unit in $units; do
            systemctl enable "$unit.service"
        done
        systemctl enable ilns.target
        echo "install.sh: edit $etc/navigator.toml and $etc/processes.toml, then: systemctl start ilns.target"
    fi
}

do_uninstall() {
    if [ -z "$root" ]; then
        systemctl disable --now ilns.target || true
        for unit in $units; do
            systemctl disable --now "$unit.service" || true
        done
    fi
    for unit in "$here"/systemd/*.service "$here"/systemd/*.target; do
        rm -f "$system/$(basename "$unit")"
    done
    rm -f "$bin/ilns" "$sysusers/ilns.conf" "$tmpfiles/ilns.conf" "$doc/README.md"
    [ ! -d "$doc" ] || rmdir --ignore-fail-on-non-empty "$doc"
    if [ "$purge" = yes ]; then
        rm -rf "$etc" "$root/var/lib/ilns"
    fi
    if [ -z "$root" ]; then
        systemctl daemon-reload
    fi
}

case $action in
    install) do_install ;;
    uninstall) do_uninstall ;;
    *) fail "$action is unknown; expected $usage" ;;
esac
