import js from "@eslint/js";
import stylistic from "@stylistic/eslint-plugin";
import globals from "globals";

export default [
  js.configs.recommended,
  {
    files: ["lookdev/**/*.js"],
    languageOptions: { ecmaVersion: 2023, sourceType: "module", globals: { ...globals.browser, review: "writable" } },
    plugins: { stylistic },
    rules: {
      "stylistic/max-len": ["error", { code: 100 }],
      "prefer-const": "error",
      eqeqeq: "error",
      "no-var": "error",
      "no-shadow": "error",
      "no-unused-vars": ["error", { args: "after-used", caughtErrors: "none" }],
    },
  },
];
