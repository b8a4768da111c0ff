// The module for other people's pages: one file beside the page, with three.js left to whoever uses it; and three.js
// itself for the example, which must work without the internet.

import { copyFileSync, writeFileSync } from "node:fs";

import { build, defineConfig, type BuildOptions } from "vite";

import { declarations } from "./tools/declarations.ts";

const out = "lightwell_client/static";

function library(entry: string, file: string, external: RegExp[]): BuildOptions {
  return {
    outDir: out,
    emptyOutDir: false,
    lib: { entry, formats: ["es"], fileName: () => file },
    rolldownOptions: { external, output: { minify: true } },
    chunkSizeWarningLimit: 1000, // three.js whole
  };
}

export default defineConfig({
  publicDir: false,
  build: library("src/module/index.ts", "lightwell-three.js", [/^three($|\/)/]),
  plugins: [
    {
      name: "types",
      closeBundle() {
        writeFileSync(`${out}/lightwell-three.d.ts`, declarations());
      },
    },
    {
      name: "three-for-the-example",
      async closeBundle() {
        const options = library("node_modules/three/build/three.module.js", "three/three.module.min.js", []);
        await build({ configFile: false, publicDir: false, logLevel: "warn", build: options });
        copyFileSync("node_modules/three/examples/jsm/controls/OrbitControls.js", `${out}/three/OrbitControls.js`);
      },
    },
  ],
});
