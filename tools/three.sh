#!/bin/sh
# Makes src/stereopsis/view/static/vendor/three.min.js from npm's three and esbuild, at the versions that are stated there.
set -eu
vendor=$(cd "$(dirname "$0")/.." && pwd)/src/stereopsis/view/static/vendor
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-save three@0.187.0 esbuild@0.28.2
cat > three.js <<'END'
export {
  BufferAttribute, BufferGeometry, Color, DoubleSide, Mesh, PerspectiveCamera, Points, Scene, ShaderMaterial, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
END
npx esbuild three.js --bundle --minify --format=esm --legal-comments=none --outfile="$vendor/three.min.js"
cp node_modules/three/LICENSE "$vendor/three.LICENSE"
