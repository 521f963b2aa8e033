#!/bin/sh
# The overlay compiles without a warning, applies, and gives the keys that the profiles name.
set -eu
overlay=$1
base=$(dirname "$0")/base.dts
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

fail() {
	echo "$*" >&2
	exit 1
}

# What dtc says of phandles it cannot see in an overlay alone is no fault.
dtc -@ -I dts -O dtb -W no-gpios_property -o "$folder/overlay.dtbo" "$overlay" 2>"$folder/warnings"
[ ! -s "$folder/warnings" ] || fail "dtc warns: $(cat "$folder/warnings")"
dtc -@ -I dts -O dtb -o "$folder/base.dtb" "$base"
fdtoverlay -i "$folder/base.dtb" -o "$folder/tree.dtb" "$folder/overlay.dtbo"

# NAME KEY PIN: of F1, F2, F3 in linux/input-event-codes.h and of board/rpi5.ini.
check() {
	node=/diorama-buttons/$1
	got=$(fdtget "$folder/tree.dtb" "$node" linux,code)
	[ "$got" = "$2" ] || fail "$node has key $got, not $2"
	# A phandle, the pin, active low.
	got=$(fdtget "$folder/tree.dtb" "$node" gpios | cut -d' ' -f2-)
	[ "$got" = "$3 1" ] || fail "$node has line '$got', not '$3 1'"
	awk -v want="[button $1]" '$0 == want { here = 1; next } /^\[/ { here = 0 }
		here && $1 == "line" { print $3 }' "$(dirname "$overlay")/../rpi5.ini" >"$folder/line"
	grep -qx "GPIO$3" "$folder/line" || fail "board/rpi5.ini: [button $1] has another line"
}
check calibrate 59 17
check capture 60 27
check view 61 22
echo "the overlay applies: 3 keys"
