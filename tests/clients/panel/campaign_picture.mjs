// Draws the picture of a campaign's page for the documentation: node campaign_picture.mjs PVE_SIM MODULES FILE

import { spawnSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { withBrowser } from "./rig.mjs";

const [, , binary, , file] = process.argv;
const root = join(dirname(fileURLToPath(import.meta.url)), "../../..");
const folder = mkdtempSync(join(tmpdir(), "campaign-"));
const html = join(folder, "campaign.html");
spawnSync(binary, ["campaign", "scenarios/campaigns/valve-careless.toml", "--html", html, "--results", join(folder, "results")], { cwd: root });
await withBrowser({ viewport: { width: 1280, height: 860 }, colorScheme: "light" }, async (page) => {
  await page.goto(pathToFileURL(html).href);
  await page.screenshot({ path: file });
});
rmSync(folder, { recursive: true });
