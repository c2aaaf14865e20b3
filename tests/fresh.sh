#!/bin/sh
# What a newcomer does: clone into an empty HOME, `make book`, `make test` (or the targets that are named: fresh.sh book).
# Root does it twice, first from a new account without sudo; anybody else once.
# CI is handed on to root alone: the other account cannot install Chromium, and may skip the tests that need it.
set -u
root=$(cd "$(dirname "$0")/.." && pwd) || exit 1
targets=${*:-book test}
ci=${CI:-} status=0 account=
for name in $(env | sed -n 's/^\([A-Za-z_][A-Za-z0-9_]*\)=.*/\1/p'); do
    case $name in
    PIP_CACHE_DIR) unset "$name" ;;
    PATH | PIP_* | SSL_CERT_* | REQUESTS_CA_BUNDLE | *_proxy | *_PROXY) ;; # the way to the packages
    *) unset "$name" ;;
    esac
done
umask 022
work=$(mktemp -d) && chmod 755 "$work" || exit 1
leave() {
    cd / && rm -rf "$work" || status=1
    [ -z "$account" ] || userdel "$account" || status=1
    exit "$status"
}
trap leave EXIT
trap 'status=130; exit' HUP INT TERM
printf '[safe]\n\tdirectory = *\n' >"$work/gitconfig" # whoever owns the checkout

visit() { # LABEL [COMMAND THAT CHANGES THE ACCOUNT]
    label=$1 home=$work/home
    shift
    if ! {
        cd / && rm -rf "$home" && mkdir -p "$home/tmp" &&
            GIT_CONFIG_GLOBAL=$work/gitconfig git clone -q --no-hardlinks "$root" "$home/clone" &&
            chown -R "$owner" "$home" && cd "$home/clone"
    }; then
        status=1
        return
    fi
    # shellcheck disable=SC2016
    if [ -z "$("$@" make -s --eval='python: ; @echo $(PYTHON)' python)" ]; then
        echo "$label: skipped: finds no Python 3.11 or newer with venv (Debian: apt-get install python3.11-venv)"
        [ "$ci" != true ] || status=1
        return
    fi
    for target in $targets; do
        began=$(date +%s) result=well lines=8
        "$@" env HOME="$home" TMPDIR="$home/tmp" make "$target" >"$work/log" 2>&1 </dev/null || result=FAILED lines=60 status=1
        echo "$label: make $target: $result, $(($(date +%s) - began)) s"
        tail -n "$lines" "$work/log" | sed 's/^/    /'
    done
}

owner=$(id -u)
if [ "$owner" = 0 ]; then
    if useradd --no-create-home --home-dir "$work/home" "fresh$$"; then
        account=fresh$$ owner=fresh$$
        visit "not root" runuser -u "$account" --
    else
        status=1
    fi
    owner=0
    visit root env ${ci:+CI="$ci"}
else
    visit "not root" env
fi
