#!/usr/bin/env bash
# Makes a Debian package of what `cargo build --release --workspace` has built: programs in /usr/lib/whorl, parameters in /etc/whorl, units,
# an example of udev rules, pages. usage: packaging/debian.sh [FOLDER_OF_PROGRAMS [FOLDER_FOR_THE_PACKAGE]]
set -euo pipefail
cd "$(dirname "$0")/.."
programs=${1:-target/release}
out=${2:-target}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
architecture=$(dpkg --print-architecture)
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
chmod 755 "$stage"

install -d "$stage"/DEBIAN "$stage"/usr/{bin,lib/whorl,lib/systemd/system,share/doc/whorl} "$stage"/etc/whorl
for program in whorl driver estimator local_control model_monitor coordinator recorder; do
    install -m 755 "$programs/$program" "$stage/usr/lib/whorl/"
done
ln -s ../lib/whorl/whorl "$stage/usr/bin/whorl"
cp -r params "$stage/etc/whorl/"
install -m 644 packaging/etc/environment "$stage/etc/whorl/"
install -m 644 packaging/systemd/*.service "$stage/usr/lib/systemd/system/"
install -m 644 packaging/udev/60-whorl.rules docs/*.md LICENSE "$stage/usr/share/doc/whorl/"
find "$stage/etc" -type f -printf '/etc/%P\n' | sort > "$stage/DEBIAN/conffiles"

cat > "$stage/DEBIAN/control" <<CONTROL
Package: whorl
Version: $version
Architecture: $architecture
Maintainer: Whorl <root@localhost>
Depends: libc6, adduser
Recommends: chrony
Section: science
Priority: optional
Description: coordination of spherical air-bearing platforms
 Nodes of ROS 2 for platforms that rehearse spacecraft formation flying, and commands that explain their motion.
CONTROL
cat > "$stage/DEBIAN/postinst" <<'SCRIPT'
#!/bin/sh
set -e
if ! getent passwd whorl > /dev/null; then
    adduser --system --group --home /var/lib/whorl --no-create-home whorl
fi
if [ -d /run/systemd/system ]; then systemctl daemon-reload; fi
SCRIPT
chmod 755 "$stage/DEBIAN/postinst"
mkdir -p "$out"
dpkg-deb --root-owner-group --build "$stage" "$out/whorl_${version}_$architecture.deb"
