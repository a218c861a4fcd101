import { defineConfig } from "vitest/config";

// Time never decides: on a busy machine what takes a second takes ten.
export default defineConfig({ test: { include: ["test/**/*.test.ts"], testTimeout: 120_000, hookTimeout: 120_000 } });
