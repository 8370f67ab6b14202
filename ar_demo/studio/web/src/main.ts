/** The page: opens a project, and draws it whenever its state changes. */

import { html, nothing, render } from "lit-html";
import * as api from "./api";
import { failure, typed } from "./controls";
import { chooseFile, help } from "./dialogs";
import { hint } from "./hints";
import { icons } from "./icons";
import { listen } from "./keys";
import type { Project } from "./model";
import { finish } from "./panels/finish";
import { look } from "./panels/look";
import { mark } from "./panels/mark";
import { surfaces } from "./panels/surfaces";
import { track } from "./panels/track";
import { Player } from "./player";
import { Stage } from "./stage/stage";
import { STEPS, Studio, type View } from "./studio";
import { followTheme, isDark, switchTheme } from "./theme";
import { TimeLine } from "./timeline";
import { clock, stateName } from "./words";

const app = document.querySelector<HTMLElement>("#app")!;
const STEP_NAMES = { mark: "Mark", track: "Track", look: "Look", finish: "Finish" };
const VIEWS: [View, string][] = [
  ["frame", "Video"],
  ["wipe", "Before | after"],
  ["composite", "Result"],
  ["steady", "Steady"],
];

function edit(project: Project): void {
  document.title = `${project.name} – Studio`;
  history.replaceState(null, "", `#${project.id}`);
  const studio = new Studio(project);
  const stage = new Stage(studio);
  const timeline = new TimeLine(studio, studio.doc.api);
  const player = new Player(studio);
  stage.onDrawn = (frame) => player.shown(frame);
  listen(studio, player, stage, help);
  followTheme(() => timeline.repaint());

  const chooseAd = async () => {
    const file = await chooseFile("Choose an ad", ["ad"]);
    if (file) {
      studio.clear("ad");
      studio.editSurface("", (s) => Object.assign(s, { ad: file.id, ad_name: file.name, effect: "replace" }));
    }
  };
  const seek = (frame: number) => {
    player.stop();
    studio.following = false;
    studio.seek(frame);
  };
  const button = (label: string, icon: unknown, act: () => void, disabled = false, pressed?: boolean) =>
    html`<button class="quiet square" type="button" title=${label} aria-label=${label} ?disabled=${disabled}
      aria-pressed=${pressed ?? nothing} @click=${act}>${icon}</button>`;

  const done = { mark: 0, track: 0 };
  const steps = () => {
    const all = studio.project.surfaces;
    done.mark = all.filter((s) => s.quad && (s.ad || s.effect !== "replace")).length;
    done.track = all.filter((s) => s.track && !s.track.stale).length;
    return html`<nav class="steps" aria-label="Steps">
      <ol>
        ${STEPS.map((step, i) => {
          const isDone = (step === "mark" || step === "track") && done[step] === all.length;
          return html`<li><button type="button" aria-current=${studio.step === step ? "step" : nothing} @click=${() => studio.go(step)}>
            <span class="number" aria-hidden="true">${isDone ? icons.check : i + 1}</span>${STEP_NAMES[step]}
            ${isDone ? html`<span class="unseen">, done</span>` : nothing}
          </button></li>`;
        })}
      </ol>
    </nav>`;
  };

  const header = () => html`<header class="top">
    <div class="title"><img src="/static/icon.svg" alt="" width="22" height="22" /><h1>${studio.video.name}</h1>
      ${button("Open another video or job", icons.open, () => void open())}
    </div>
    ${steps()}
    <div class="tools">
      <span class="saved" role="status">${studio.errors.save ? "Not saved" : studio.doc.isSaved ? "Saved" : "Saving…"}</span>
      ${button("Undo (Ctrl Z)", icons.undo, () => studio.undo(), !studio.doc.canUndo)}
      ${button("Redo (Ctrl Shift Z)", icons.redo, () => studio.redo(), !studio.doc.canRedo)}
      ${button(isDark() ? "Light colours" : "Dark colours", isDark() ? icons.sun : icons.moon, () => {
        switchTheme();
        timeline.repaint();
        studio.changed();
      })}
      ${button("Keys (?)", icons.help, help)}
    </div>
  </header>`;

  const views = () => {
    const { surface } = studio;
    const can = { frame: true, wipe: !!surface?.quad || !!surface?.track, composite: !!surface?.quad || !!surface?.track, steady: !!surface?.track };
    return html`<div class="views" role="group" aria-label="What is shown">
      ${VIEWS.map(([view, label]) => html`<button type="button" aria-pressed=${studio.view === view} ?disabled=${!can[view]}
        @click=${() => studio.show(view)}>${label}</button>`)}
    </div>
    <div class="row zoom" role="group" aria-label="Zoom">
      ${button("Zoom out (−)", icons.zoomOut, () => stage.zoom(1 / 1.5), !stage.isZoomed)}
      ${button("Whole picture (0)", icons.fit, () => stage.fit(), !stage.isZoomed)}
      ${button("Zoom in (+)", icons.zoomIn, () => stage.zoom(1.5))}
    </div>`;
  };

  const transport = () => {
    const { frame, video, surface } = studio;
    const known = surface && studio.tracks.of(surface);
    const state = known?.states[frame]?.trim();
    const deviation = known?.deviation[frame];
    return html`<div class="transport">
      <div class="row">
        ${button("First frame (Home)", icons.first, () => seek(0))}
        ${button("A frame back (←)", icons.back, () => seek(frame - 1))}
        ${button(player.speed ? "Stop (Space)" : "Play (Space)", player.speed ? icons.pause : icons.play, () => player.toggle())}
        ${button("A frame on (→)", icons.on, () => seek(frame + 1))}
        ${button("Last frame (End)", icons.last, () => seek(video.frames - 1))}
        ${button("Play the two seconds around here, again and again", icons.loop, () => {
          studio.looping = !studio.looping;
          player.stop();
          studio.changed();
        }, false, studio.looping)}
      </div>
      <p class="where">
        <label for="frame">Frame</label>
        ${typed({ id: "frame", min: 0, max: video.frames - 1 }, `${frame}`, (text) => {
          seek(parseInt(text, 10) || 0);
          return `${studio.frame}`;
        })}
        <span>of ${video.frames - 1}</span><span class="clock">${clock(video.times[frame] ?? 0)}</span>
        ${Math.abs(player.speed) > 1 || player.speed < 0 ? html`<span>${player.speed}×</span>` : nothing}
      </p>
      ${state
        ? html`<p class="state ${state}"><span class="dot"></span>${stateName(state)}${deviation !== null && deviation !== undefined && state !== "l" ? html` <small>± ${deviation.toFixed(1)} px</small>` : nothing}</p>`
        : nothing}
      ${known
        ? html`<p class="legend" aria-hidden="true"><span class="confidence">confidence</span><span class="deviation">deviation, up to 8 px</span></p>`
        : nothing}
    </div>`;
  };

  const panel = () => {
    if (studio.step === "mark") return mark(studio, chooseAd);
    if (studio.step === "track") return track(studio);
    if (studio.step === "look") return look(studio, chooseAd);
    return finish(studio);
  };

  const draw = () => {
    render(
      html`${header()}
        <main class="work">
          <div class="above">${hint(studio)} ${views()}</div>
          <div class="viewport">${stage.element}</div>
          ${transport()} ${timeline.element}
        </main>
        <aside class="panel" aria-label=${STEP_NAMES[studio.step]}>
          ${studio.step === "finish" ? nothing : surfaces(studio, chooseAd)}
          ${studio.step === "look" || studio.step === "finish" ? nothing : failure(studio.errors.save)} ${panel()}
        </aside>`,
      app,
    );
    stage.update();
    timeline.update();
  };
  studio.watch(draw);
  studio.changed();
}

/** Lets a video or a job be chosen, and edits it. */
async function open(): Promise<void> {
  const file = await chooseFile("Open a video or a job", ["video", "job"]);
  if (!file) return;
  try {
    const project = await api.openProject(file.kind === "job" ? { job: file.id } : { video: file.id });
    location.hash = project.id;
    location.reload();
  } catch (error) {
    welcome((error as Error).message);
  }
}

function welcome(error = ""): void {
  followTheme(() => undefined);
  render(
    html`<main class="welcome">
      <img src="/static/icon.svg" alt="" width="56" height="56" />
      <h1>Studio</h1>
      <p>Put an ad on a surface of a video: mark it in one frame, and it is followed through all others.</p>
      ${failure(error)}
      <button class="primary" type="button" @click=${() => void open()}>Open a video…</button>
    </main>`,
    app,
  );
}

async function begin(): Promise<void> {
  try {
    const known = await api.projects();
    const wanted = known.find((p) => p.id === location.hash.slice(1)) ?? known[0];
    if (wanted) edit(await api.readProject(wanted.id));
    else welcome();
  } catch (error) {
    welcome((error as Error).message);
  }
}

void begin();
