// The page of `smpl live`.

import "uplot/dist/uPlot.min.css";
import "./style/live.css";
import { Client, type Socket } from "./client.ts";
import { Page } from "./page.ts";
import { connectFromPage } from "./session.ts";

const root = document.getElementById("app");
if (root) {
  const page: { current: Page | null } = { current: null };
  const client = connectFromPage(
    (connected) => void page.current?.connection(connected),
    (connect, onState) => new Client(() => connect() as unknown as Socket, onState),
  );
  page.current = new Page(root, client);
  client.start();
}
