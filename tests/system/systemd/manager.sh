#!/bin/sh
# Becomes Debian's systemd as PID 1 of namespaces of its own, on a layer of memory above this
# computer's files. It has `motord service install` write the unit, runs `scenario` and ends.
#
#   unshare --pid --fork --mount --cgroup --net --ipc --uts sh manager.sh LAYER
#
# LAYER has what it needs: opt/ (sources, packages), bench.toml, cache/, out/
set -e
layer=$1 whole=$1/whole
mount --make-rprivate /
mount -t tmpfs layer "$layer/memory"
mkdir "$layer/memory/upper" "$layer/memory/work"
mount -t overlay -o "lowerdir=/,upperdir=$layer/memory/upper,workdir=$layer/memory/work" root "$whole"
mount -t proc proc "$whole/proc"
mount -t sysfs -o ro sysfs "$whole/sys"
mount -t cgroup2 cgroup "$whole/sys/fs/cgroup"
mount -t tmpfs run "$whole/run"
mount -t tmpfs tmp "$whole/tmp"
mount -t tmpfs dev "$whole/dev"
for device in null zero full random urandom tty; do
    touch "$whole/dev/$device" && mount --bind "/dev/$device" "$whole/dev/$device"
done
mkdir "$whole/dev/pts" "$whole/dev/shm"
mount -t tmpfs shm "$whole/dev/shm"
mkdir -p "$whole/opt/motord" "$whole/run/out" "$whole/etc/motord" "$whole/var/cache/motord"
mount --rbind "$layer/opt" "$whole/opt/motord"
mount --bind "$layer/out" "$whole/run/out"
cp -a "$layer/cache/." "$whole/var/cache/motord"
cp "$layer/bench.toml" "$whole/etc/motord/bench.toml"

# nothing of this computer's own services starts here
rm -rf "$whole"/etc/systemd/system/* "$whole/etc/systemd/system.conf.d"
: > "$whole/etc/machine-id"
chroot "$whole" /opt/motord/bin/motord service install --root / -c /etc/motord/bench.toml \
    --program /opt/motord/bin/motord
chroot "$whole" systemd-sysusers /etc/sysusers.d/motord.conf
mkdir "$whole/etc/systemd/system/motord.service.d"
cat > "$whole/etc/systemd/system/motord.service.d/record.conf" <<'UNIT'
[Service]
ExecStopPost=+/bin/sh -c 'echo "$$SERVICE_RESULT" >> /run/out/results'
StandardOutput=append:/run/out/log
StandardError=append:/run/out/log
UNIT
cat > "$whole/etc/systemd/system/scenario.service" <<UNIT
[Unit]
DefaultDependencies=no
[Service]
Type=oneshot
ExecStart=/opt/motord/bin/scenario
StandardOutput=file:/run/out/said
StandardError=file:/run/out/said
ExecStopPost=/bin/sh -c 'chmod -R a+rX /run/out'
ExecStopPost=/bin/sh -c 'chown -R --reference=/run/out /run/out/*; systemctl exit'
UNIT
cat > "$whole/etc/systemd/system/scenario.target" <<UNIT
[Unit]
DefaultDependencies=no
Wants=scenario.service
UNIT
export container=motord
exec chroot "$whole" /lib/systemd/systemd --unit=scenario.target --log-target=null --show-status=no
