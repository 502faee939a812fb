#!/bin/sh
# Makes the certificates of one site: an authority of its own (once), and one certificate a name.
#
#   certificates.sh DIR NAME [HOST_OR_ADDRESS...]
#
# DIR/ca.pem, DIR/ca.key      the authority; keep ca.key off the plant network
# DIR/NAME.pem, DIR/NAME.key  the certificate with common name NAME, which bus.access goes by
#
# With hosts it is for a daemon: clients believe it there, and on localhost. Without any it is for a
# client, and no client will take it for a daemon. URI=urn:lumpwatch:SITE:gateway makes one for the gateway's OPC UA
# server (RSA, since OPC UA's policies know no other). DAYS sets how long a new certificate holds (default 825), CA_DAYS the authority (3650).
set -eu
umask 077

if [ $# -lt 2 ]; then
    echo "usage: $0 DIR NAME [HOST_OR_ADDRESS...]" >&2
    exit 2
fi
dir=$1 name=$2
shift 2
case $name in
    *[!A-Za-z0-9._-]* | "" | ca) echo "$0: '$name': a name has letters, digits, dot, dash, underscore, and is not ca" >&2; exit 2 ;;
esac
command -v openssl >/dev/null || { echo "$0: openssl is not installed" >&2; exit 1; }
mkdir -p "$dir"

key() { openssl genpkey -quiet -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1"; }

if [ ! -e "$dir/ca.pem" ]; then
    key "$dir/ca.key"
    openssl req -x509 -new -key "$dir/ca.key" -days "${CA_DAYS:-3650}" -subj "/CN=lumpwatch site authority" \
        -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign,cRLSign" -out "$dir/ca.pem"
    echo "made $dir/ca.pem"
fi
if [ -e "$dir/$name.pem" ]; then
    echo "$0: $dir/$name.pem exists: remove it first to make it anew" >&2
    exit 1
fi

names="DNS:localhost,IP:127.0.0.1" usage=serverAuth,clientAuth
[ $# -gt 0 ] || names="" usage=clientAuth
for host in "$@"; do
    case $host in
        *:* | [0-9]*.[0-9]*.[0-9]*.[0-9]*) names="$names,IP:$host" ;;
        *) names="$names,DNS:$host" ;;
    esac
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
key_usage=digitalSignature
if [ -n "${URI:-}" ]; then
    openssl genpkey -quiet -algorithm RSA -pkeyopt rsa_keygen_bits:2048 -out "$work/key"
    names="URI:$URI${names:+,$names}" key_usage=digitalSignature,nonRepudiation,keyEncipherment,dataEncipherment
else
    key "$work/key"
fi
openssl req -new -key "$work/key" -subj "/CN=$name" -out "$work/request"
cat >"$work/extensions" <<EOF
basicConstraints=critical,CA:FALSE
keyUsage=critical,$key_usage
extendedKeyUsage=$usage
${names:+subjectAltName=$names}
EOF
openssl x509 -req -in "$work/request" -CA "$dir/ca.pem" -CAkey "$dir/ca.key" -CAserial "$dir/ca.srl" -CAcreateserial \
    -days "${DAYS:-825}" -extfile "$work/extensions" -out "$work/certificate" 2>/dev/null
mv "$work/key" "$dir/$name.key"
mv "$work/certificate" "$dir/$name.pem"
echo "made $dir/$name.pem for ${names:-a client}"
