/** palpate in a program of yours: a folder of `palpate build web`, stepped by you. Lengths in metres, forces in newtons. */

export type Place = [number, number, number] | Float64Array | number[];

export interface Contact {
  /** on the hand [N, world] */
  force: number[];
  /** normal force [N] */
  load: number;
  /** [m] */
  indentation: number;
  /** nearest point of the undeformed surface [m, world] */
  foot: number[];
  /** of the surface, outwards */
  normal: number[];
  /** null without friction */
  sticks: boolean | null;
}

export interface Surface {
  /** displaced vertices, counted from `first` of the mesh */
  nodes: Int32Array;
  /** three numbers for each of them [m] */
  displacement: Float64Array;
  /** first vertex of this body in the mesh */
  first: number;
}

export interface Mesh { triangles: Uint32Array; vertices: Float32Array; normals: Float32Array; }

export interface Failure { node: string; tick: number; why: string; }

export class Touch {
  readonly mesh: Mesh;
  readonly body: string;
  readonly effects: Record<string, boolean>;
  /** simulated time since the start [s] */
  readonly time: number;
  /** ticks per second */
  readonly rate: number;
  readonly fingers: number;
  /** of a fingertip, from skin to bone [m] */
  readonly thickness: number;
  readonly failed: Failure | null;
  /** what the page shows: `plan`, `hard` (cases), `limit` of the force on the hand [N], `figures` of the bodies, and more */
  readonly head: Record<string, unknown>;
  begin(): void;
  point(place: Place, options?: { finger?: number; buttons?: number }): void;
  /** leaves out time [s], as a run on the real clock that is late */
  skip(seconds: number): void;
  step(seconds?: number): boolean;
  contact(finger?: number): Contact | null;
  /** arrays that show the memory of the tick; they change with the next step */
  surface(body?: number): Surface | null;
  /** the state as a message to the page: JSON with its length, then arrays; null before the first contact message */
  frame(): ArrayBuffer | null;
  read(stream: string, field: string): unknown;
  /** an MCAP file for `palpate replay` */
  recording(): Blob;
}

/** folder: its address, or a function that returns the text of a file in it */
export function load(folder: string | ((name: string) => Promise<string>), options?: { scene?: string; organ?: string; body?: string; effects?: Record<string, boolean>; hard?: string | null }): Promise<Touch>;
