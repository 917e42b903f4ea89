// Bundles the page into `dist/`: index.html, live.js, live.css. Options: --watch, --sizes.
import { build, context } from "esbuild";
import { copyFileSync, mkdirSync, readFileSync } from "node:fs";
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
  legalComments: "eof",
  logLevel: "warning",
};

mkdirSync(`${here}dist`, { recursive: true });
copyFileSync(`${here}src/index.html`, `${here}dist/index.html`);

if (process.argv.includes("--watch")) {
  await (await context(options)).watch();
} else {
  await build(options);
  if (process.argv.includes("--sizes")) {
    for (const name of ["index.html", "live.js", "live.css"]) {
      const bytes = readFileSync(`${here}dist/${name}`);
      console.log(`${name}: ${bytes.length} bytes, ${gzipSync(bytes, { level: 9 }).length} gzipped`);
    }
  }
}
