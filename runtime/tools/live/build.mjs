// Bundles the page into `dist/`: index.html, live.js, live.css, licenses.txt. Options: --watch, --sizes.
import { build, context } from "esbuild";
import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const here = new URL(".", import.meta.url).pathname;
const options = {
  absWorkingDir: here,
  entryPoints: { live: "src/main.ts" },
  outdir: "dist",
  bundle: true,
  minify: true,
  format: "iife",
  target: ["chrome110", "firefox110", "safari16"],
  charset: "utf8",
  legalComments: "none",
  logLevel: "warning",
  metafile: true,
};

mkdirSync(`${here}dist`, { recursive: true });
copyFileSync(`${here}src/index.html`, `${here}dist/index.html`);

if (process.argv.includes("--watch")) {
  await (await context(options)).watch();
} else {
  const { metafile } = await build(options);
  writeFileSync(`${here}dist/licenses.txt`, licenses(metafile));
  if (process.argv.includes("--sizes")) sizes(metafile);
}

/** Licences of the packages of which something is in the bundle. */
function licenses(metafile) {
  return packages(metafile).map((name) => {
    const folder = `${here}node_modules/${name}`;
    const { version, license } = JSON.parse(readFileSync(`${folder}/package.json`, "utf8"));
    const file = readdirSync(folder).find((entry) => /^licen[cs]e/i.test(entry));
    if (!file || !existsSync(`${folder}/${file}`)) throw new Error(`${name} has no text of its licence`);
    return `${name} ${version} (${license})\n\n${readFileSync(`${folder}/${file}`, "utf8").trim()}\n`;
  }).join(`\n${"-".repeat(80)}\n\n`);
}

function packages(metafile) {
  const names = Object.keys(metafile.inputs).map((path) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1]);
  return [...new Set(names.filter(Boolean))].sort();
}

/** Prints the sizes of the files, and what each package adds to the script. */
function sizes(metafile) {
  for (const name of ["index.html", "live.js", "live.css"]) {
    const bytes = readFileSync(`${here}dist/${name}`);
    console.log(`${name}: ${bytes.length} bytes, ${gzipSync(bytes, { level: 9 }).length} gzipped`);
  }
  const parts = new Map();
  for (const [path, { bytesInOutput }] of Object.entries(metafile.outputs["dist/live.js"].inputs)) {
    const name = /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1] ?? "page";
    parts.set(name, (parts.get(name) ?? 0) + bytesInOutput);
  }
  for (const [name, bytes] of [...parts].sort((a, b) => b[1] - a[1])) console.log(`  ${name}: ${bytes}`);
}
