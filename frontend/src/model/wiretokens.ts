/** What the server says of access tokens. */

import type { components } from "./api.gen";

type Answers = components["schemas"];

export type AccessToken = Answers["AccessTokenRow"];
export type NewAccessToken = Answers["NewAccessToken"];
export type MakeAccessToken = Answers["MakeAccessToken"];
export type TokenScope = AccessToken["scope"];
