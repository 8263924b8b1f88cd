import { launch, open, saved } from "./support/browser.js";
import { serve } from "./support/server.js";
import { readFileSync, writeFileSync } from "node:fs";
const [,, video, camera, sport, out, w="1280", sec="0"] = process.argv;
const server = await serve(); const browser = await launch({ webgpu: false }); const complaints=[];
const page = await open(browser, `${server.url}#video`, complaints, { anyBall: true, viewport: { width: +w, height: 900 } });
await page.getByTestId("video-example").waitFor();
await page.getByTestId("video-sport").selectOption(sport);
if (process.env.BALL) { await page.getByTestId("video-ball").fill(process.env.BALL); await page.getByTestId("video-ball").dispatchEvent("change"); }
await page.getByTestId("video-input").setInputFiles([{ name: video.split("/").pop(), mimeType: "video/mp4", buffer: readFileSync(video) }, { name: "camera.json", mimeType: "application/json", buffer: readFileSync(camera) }]);
await page.waitForTimeout(4000);
await page.screenshot({ path: out.replace(".png", "-before.png"), fullPage: true });
const t0 = Date.now();
await page.getByTestId("video-track").click();
await page.waitForTimeout(5000);
await page.screenshot({ path: out.replace(".png", "-during.png"), fullPage: false });
try { await page.getByTestId("video-fit-words").waitFor({ timeout: 300000 }); } catch (e) { console.log("no fit", await page.getByTestId("video-alert").textContent()); }
console.log("tracked in", (Date.now()-t0)/1000, "s", await page.getByTestId("video-fit-result").innerText());
await page.waitForTimeout(1000);
if (+sec) { await page.getByTestId("video-time").evaluate((s, v) => { s.value = String(v*1000); s.dispatchEvent(new Event("input")); }, sec); await page.waitForTimeout(1500); }
await page.screenshot({ path: out, fullPage: true });
try { writeFileSync(out.replace(".png", ".json"), await saved(page, "video-json")); } catch (e) { console.log(String(e).slice(0,200)); }
console.log(complaints, await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]));
await browser.close(); await server.close();
