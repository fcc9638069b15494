/** What the server says of access tokens. */

import type { components } from "./api.gen";

export type AccessToken = components["schemas"]["AccessTokenRow"];
export type NewAccessToken = components["schemas"]["NewAccessToken"];
export type MakeAccessToken = components["schemas"]["MakeAccessToken"];
export type TokenScope = AccessToken["scope"];
