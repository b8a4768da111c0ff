import { defineConfig } from "vitest/config";

const server = "http://127.0.0.1:8400";

export default defineConfig({
  base: "./", // the page works under any path of a reverse proxy
  build: {
    outDir: "lightwell_client/static",
    emptyOutDir: true,
    rolldownOptions: { input: ["index.html", "selfcheck.html", "frames.html"] },
    chunkSizeWarningLimit: 800, // three.js alone is over the default
  },
  server: { proxy: { "/api": { target: server, ws: true } } },
  test: { include: ["src/**/*.test.ts"] },
});
