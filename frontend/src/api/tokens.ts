/** Access tokens: read, made, revoked. */

import { useQuery, type UseMutationResult, type UseQueryResult } from "@tanstack/react-query";
import type { AccessToken, MakeAccessToken, NewAccessToken } from "@/model/wiretokens";
import { useAct } from "./act";
import { call } from "./client";
import { keys } from "./keys";
import { client } from "./live";
import { every } from "./pages";

export type Whose = "me" | "all";

export function useTokens(of: Whose): UseQueryResult<AccessToken[]> {
  return useQuery({
    queryKey: keys.tokenList(of),
    queryFn: every<AccessToken>(`/tokens?of=${of}`, "tokens"),
  });
}

export function useMakeToken(): UseMutationResult<NewAccessToken, Error, MakeAccessToken> {
  return useAct({
    mutationFn: (wanted) => call<NewAccessToken>("POST", "/tokens", wanted),
    onSuccess: () => void client.invalidateQueries({ queryKey: keys.tokens }),
  });
}

export function useRevokeToken(): UseMutationResult<null, Error, string> {
  return useAct({
    mutationFn: (id) => call<null>("DELETE", `/tokens/${id}`),
    onSettled: () => void client.invalidateQueries({ queryKey: keys.tokens }),
  });
}
