/** The page. The world's address is `?world=…`; without it, the world beside the page. With `?sessions=0` no server decides what to send. */
import "./style.css";
import { FarfieldError } from "../core/errors.js";
import { pageOf } from "./api.js";
import { Application, type PageElements } from "./application.js";
import { Messages } from "./messages.js";

function find<E extends HTMLElement>(id: string): E {
  return document.getElementById(id) as E;
}

const elements: PageElements = {
  canvas: find("picture"),
  panel: find("panel"),
  credits: find("credits"),
  banner: find("banner"),
  picked: find("picked"),
  marker: find("marker"),
  progress: find("progress"),
  message: find("message"),
  overlay: find("interface"),
};

const context = elements.canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
const query = new URLSearchParams(location.search);
const address = new URL(query.get("world") ?? "./", location.href);
if (context) {
  window.farfield = pageOf(new Application(address, context, elements, { sessions: query.get("sessions") !== "0" }));
} else {
  const hint = "Try a current Firefox, Chrome, Edge or Safari, and switch hardware acceleration on.";
  const messages = new Messages(elements.message, elements.banner, () => undefined);
  messages.fail(new FarfieldError("unsupported", "It offers no WebGL 2, which farfield draws with.", "", hint));
}
