/** The server's HTTP interface; every failure is an `ApiError` with one sentence. */

import type { Corners, Doc, Entry, Listing, Output, Project, Proposal, ServerEvent, Task, Track } from "./model";

export class ApiError extends Error {
  constructor(
    message: string,
    readonly status: number,
    readonly body: Record<string, unknown>,
  ) {
    super(message);
  }

  /** The field that the error belongs to, as "surfaces.0.quad". */
  get field(): string | null {
    return typeof this.body.field === "string" ? this.body.field : null;
  }
}

/** The server's errors are clauses; names of files that they begin with stay as they are. */
export function sentence(text: string): string {
  const clause = text.trim().replace(/\.$/, "");
  return /^[a-z]+[\s,:']/.test(clause) ? `${clause[0].toUpperCase()}${clause.slice(1)}.` : `${clause}.`;
}

const UNREACHABLE = "The server does not answer: start ar-studio again, then reload this page.";

async function request<T>(method: string, path: string, body?: unknown): Promise<T> {
  const raw = body instanceof Blob;
  let response: Response;
  try {
    response = await fetch(`/api${path}`, {
      method,
      body: raw ? body : body === undefined ? undefined : JSON.stringify(body),
      headers: body === undefined || raw ? {} : { "Content-Type": "application/json" },
    });
  } catch {
    throw new ApiError(UNREACHABLE, 0, {});
  }
  const content = await response.json().catch(() => ({}));
  if (!response.ok) {
    throw new ApiError(sentence(content.error ?? `the server answered ${response.status}`), response.status, content);
  }
  return content as T;
}

const get = <T>(path: string) => request<T>("GET", path);
const post = <T>(path: string, body: unknown = {}) => request<T>("POST", path, body);

export const files = (kind: string, folder?: string) =>
  get<Listing>(`/files?kind=${kind}${folder ? `&folder=${encodeURIComponent(folder)}` : ""}`);
export const upload = (file: File) => post<Entry>(`/uploads?name=${encodeURIComponent(file.name)}`, file);
export const adPicture = (file: string, height: number) => `/api/files/${file}/picture?height=${height}`;

export const projects = () => get<{ id: string; name: string }[]>("/projects");
export const openProject = (what: { video: string } | { job: string }) => post<Project>("/projects", what);
export const readProject = (id: string) => get<Project>(`/projects/${id}`);

/** The calls about one project. */
export class ProjectApi {
  private readonly base: string;

  constructor(readonly id: string) {
    this.base = `/projects/${id}`;
  }

  save(revision: number, doc: Doc): Promise<Project> {
    const surfaces = doc.surfaces.map(({ key: _, ...surface }) => surface);
    return request("PUT", this.base, { revision, surfaces, tracking: doc.tracking, rendering: doc.rendering });
  }

  read = () => readProject(this.id);
  /** @param near a frame that is shown meanwhile, -1 for none. */
  frame = (index: number, height: number, near: number) => `/api${this.base}/frames/${index}?height=${height}&near=${near}`;
  roughly = (index: number, height: number) => `/api${this.base}/frames/${index}?height=${height}&rough`;
  composite = (index: number, height: number, revision: number) =>
    `/api${this.base}/composite/${index}?height=${height}&revision=${revision}`;
  steady = (surface: number, index: number, height: number, track: string) =>
    `/api${this.base}/surfaces/${surface}/steady/${index}?height=${height}&track=${track}`;

  track = (surface: number) => get<Track>(`${this.base}/surfaces/${surface}/track`);
  snap = (frame: number, corners: Corners) =>
    post<{ corners: Corners; moved: number[] }>(`${this.base}/snap`, { frame, corners });
  proposals = (frame: number) => post<{ proposals: Proposal[] }>(`${this.base}/proposals`, { frame });
  startFinding = (picture: string) => post<Task>(`${this.base}/find`, { picture });
  startTracking = () => post<Task>(`${this.base}/track`);
  startRendering = (name: string, overwrite: boolean) => post<Task>(`${this.base}/render`, { name, overwrite });
  stop = () => post<Task>(`${this.base}/stop`);
  outputs = () => get<Output[]>(`${this.base}/outputs`);

  /** Calls back for every event until closed; the connection is made again when it breaks. */
  listen(hear: (event: ServerEvent) => void, connected: (is: boolean) => void): () => void {
    let socket: WebSocket | null = null;
    let ended = false;
    let wait = 500;
    const connect = () => {
      socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/api${this.base}/events`);
      socket.onopen = () => {
        wait = 500;
        connected(true);
      };
      socket.onmessage = (message) => hear(JSON.parse(message.data as string) as ServerEvent);
      socket.onclose = () => {
        if (ended) return;
        connected(false);
        setTimeout(connect, wait);
        wait = Math.min(wait * 2, 8000);
      };
    };
    connect();
    return () => {
      ended = true;
      socket?.close();
    };
  }
}

export const outputAddress = (id: string) => `/api/outputs/${id}`;
