import reactHooks from "eslint-plugin-react-hooks";
import tseslint from "typescript-eslint";

/** Forbid imports by folder: what stands above may know what stands below, never back. */
const forbid = (folders, packages = []) => ({
  "no-restricted-imports": [
    "error",
    {
      patterns: [
        { group: ["./../*", "../*"], message: "Write @/folder/file, or ./file beside it." },
        ...folders.map((folder) => ({ group: [`@/${folder}/*`], message: "Imports go one way." })),
        ...(packages.length ? [{ group: packages, message: "model/ is TypeScript alone." }] : []),
      ],
    },
  ],
});

const screens = ["lab", "runs", "approvals", "devices", "files", "recipes", "settings"];

export default tseslint.config(
  { ignores: ["node_modules", "dist", "src/**/*.gen.ts"] },
  ...tseslint.configs.strict,
  {
    files: ["src/**/*.{ts,tsx}"],
    languageOptions: { parserOptions: { projectService: true } },
    plugins: { "react-hooks": reactHooks },
    rules: {
      "react-hooks/rules-of-hooks": "error",
      "react-hooks/exhaustive-deps": "error",
      "@typescript-eslint/no-floating-promises": "error",
      "@typescript-eslint/no-misused-promises": ["error", { checksVoidReturn: false }],
      "@typescript-eslint/consistent-type-imports": "error",
      "@typescript-eslint/switch-exhaustiveness-check": "off",
      "max-lines": ["error", { max: 400 }],
      eqeqeq: "error",
      "no-console": "error",
      ...forbid([]),
    },
  },
  {
    files: ["src/model/**"],
    rules: forbid(
      ["api", "ui", "editor", "twin", ...screens],
      ["react", "react-dom", "react-router", "@tanstack/*", "@mantine/*", "@xyflow/*", "zustand"],
    ),
  },
  {
    files: ["src/model/**"],
    ignores: ["src/**/*.test.ts"],
    rules: { "no-restricted-globals": ["error", "window", "document", "fetch", "localStorage"] },
  },
  { files: ["src/api/**"], rules: forbid(["ui", "editor", "twin", ...screens]) },
  { files: ["src/ui/**"], rules: forbid(["api", "editor", "twin", ...screens]) },
  { files: ["src/twin/**"], rules: forbid(["editor", ...screens]) },
  { files: ["src/editor/**"], rules: forbid(["twin", ...screens]) },
  ...screens.map((screen) => ({
    files: [`src/${screen}/**`],
    rules: forbid(screens.filter((other) => other !== screen && other !== "lab")),
  })),
  ...["runs", "approvals", "devices", "files", "recipes", "settings"].map((screen) => ({
    files: [`src/${screen}/**`],
    rules: forbid(screens.filter((other) => other !== screen)),
  })),
);
