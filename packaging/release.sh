#!/usr/bin/env bash
# Makes what others need to have a look without compiling: an archive of the Linux programs with parameters and pages, and a wheel
# of the Python package. usage: [WHORL_FEATURES=security] packaging/release.sh [FOLDER_FOR_THEM]
# Needs what building from source needs, and for the wheel maturin (`pip install maturin`); without it only the archive is made.
# With security, programs need OpenSSL 3 where they run; without it they are not secured (docs/security.md).
# Programs run on systems whose C library is not older than this one's: build in a container of an old system to reach more.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$(mkdir -p "${1:-target/release-files}" && cd "${1:-target/release-files}" && pwd)
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
name=whorl-$version-$(uname -m)-linux
programs=(whorl driver estimator local_control model_monitor coordinator recorder)

cargo build --release --workspace --locked --features "object_storage${WHORL_FEATURES:+,$WHORL_FEATURES}" "${programs[@]/#/--bin=}"
built=${CARGO_TARGET_DIR:-target}/release
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
install -d "$stage/$name/bin"
for program in "${programs[@]}"; do
    install -m 755 "$built/$program" "$stage/$name/bin/"
    strip "$stage/$name/bin/$program"
done
cp -r params docs LICENSE README.md CHANGELOG.md "$stage/$name/"
cat > "$stage/$name/START" <<TEXT
Put bin on your PATH, in a shell: export PATH="\$PWD/bin:\$PATH"
Then: whorl demo
or, with a recording of your own: whorl new FILE.csv
TEXT
tar --owner=0 --group=0 --sort=name -C "$stage" -czf "$out/$name.tar.gz" "$name"
# What is in it starts.
"$stage/$name/bin/whorl" --version
if command -v maturin > /dev/null; then
    maturin build --release --locked --manifest-path python/Cargo.toml --features object_storage --out "$out"
else
    echo "no wheel: there is no maturin (pip install maturin)" >&2
fi
(cd "$out" && find . -name '*.tar.gz' -o -name '*.whl' | sort | xargs sha256sum > SHA256SUMS)
ls -l "$out"
