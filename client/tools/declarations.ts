// One file of types for the module that other people's pages use: what TypeScript says of its parts, without what is private.

import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const CLIENT = fileURLToPath(new URL("..", import.meta.url));
export const TSC = join(CLIENT, "node_modules", "typescript", "bin", "tsc");
/** What is public, and where it stands. */
const PUBLIC: [file: string, name: string][] = [
  ["live", "ConnectionState"],
  ["module/surface", "SurfaceOptions"],
  ["module/probe", "ProbeOptions"],
  ["module/probe", "LightwellProbe"],
  ["module/grid", "GridOptions"],
  ["module/grid", "LightwellGrid"],
];
const HEAD = `// Types of lightwell-three.js, Lightwell's light in three.js pages: docs/module.md. Made by the build.
`;

/** The text of `lightwell-three.d.ts`. Raises `Error` where the module does not compile, or a part has another form. */
export function declarations(): string {
  const folder = mkdtempSync(join(tmpdir(), "lightwell-types-"));
  try {
    const options = ["--noEmit", "false", "--declaration", "--emitDeclarationOnly", "--rootDir", "src", "--outDir", folder];
    execFileSync(process.execPath, [TSC, "-p", "tsconfig.module.json", ...options], { cwd: CLIENT, stdio: ["ignore", "inherit", "inherit"] });
    const texts = new Map(PUBLIC.map(([file]) => [file, readFileSync(join(folder, `${file}.d.ts`), "utf-8")]));
    const body = PUBLIC.map(([file, name]) => extract(texts.get(file)!, name)).join("\n");
    const imported = [...texts.values()].flatMap((text) =>
      [...text.matchAll(/^import (?:type )?\{([^}]+)\} from "three";/gm)].flatMap(([, names]) =>
        names!.split(",").map((name) => name.replace(/\btype\b/, "").trim()),
      ),
    );
    const used = [...new Set(imported)].filter((name) => new RegExp(`\\b${name}\\b`).test(body)).sort();
    return `${HEAD}import type { ${used.join(", ")} } from "three";\n\n${body}`;
  } finally {
    rmSync(folder, { recursive: true });
  }
}

/** A declaration with the comment before it. */
function extract(text: string, name: string): string {
  const found = new RegExp(`(?:^/\\*\\*(?:(?!\\*/)[^])*\\*/\\n)?^export (?:type ${name} = [^;]+;|(?:interface|declare class) ${name} \\{\\n[^]*?^\\})`, "m").exec(text);
  if (found === null) throw new Error(`declarations.ts: there is no ${name}`);
  return `${found[0].replaceAll(/^ {4}private (?!constructor)[^\n]*\n/gm, "")}\n`;
}
